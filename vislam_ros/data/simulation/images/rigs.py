# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stereo rigs of a car in a street and of a hand or a drone in a room."""

import numpy as np

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig

# Optical axes (z ahead, x to the right, y down) in those of a body (x ahead, y to the left, z up).
_AHEAD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def street_rig(scale: float = 1.0, *, rectified: bool = False) -> StereoRig:
    """Two cameras behind a windscreen, half a metre apart, with 77 degrees of view.

    Parameters
    ----------
    scale : float
        Size of the images in that of 640 x 240.
    rectified : bool
        Draw without lenses, by two cameras that are one but for the baseline.
    """
    mount = se3.exp([0.0, 0.0, 0.0, 0.012, -0.008, 0.005])
    mount[:3, 3] = [1.0, 0.25, 0.4]
    return _rig(
        (640, 240), 402.0, 0.5, mount @ _AHEAD, [-0.13, 0.02, 0.0004, -0.0003], scale, rectified
    )


def room_rig(scale: float = 1.0, *, rectified: bool = False) -> StereoRig:
    """Two wide cameras 11 cm apart, with the strong barrel distortion of a small drone's."""
    mount = se3.exp([0.0, 0.0, 0.0, 0.02, 0.015, -0.01])
    mount[:3, 3] = [0.07, 0.055, 0.01]
    return _rig(
        (752, 480), 458.0, 0.11, mount @ _AHEAD, [-0.283, 0.074, 0.0002, 0.0], scale, rectified
    )


def _rig(
    size: tuple[int, int],
    focal_length: float,
    baseline: float,
    T_body_left: np.ndarray,
    D: list[float],
    scale: float,
    rectified: bool,
) -> StereoRig:
    image_size = (round(size[0] * scale), round(size[1] * scale))
    sides = []
    for side in range(2):
        # Two lenses of a kind differ by about a per cent, and so do the places of their centres.
        off = 0.0 if rectified else (-1.0) ** side
        fx, fy = (focal_length * scale * (1 + off * share) for share in (0.004, 0.002))
        cx = image_size[0] * (0.5 + 0.008 * off) - 0.5
        cy = image_size[1] * (0.5 - 0.01 * off) - 0.5
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        if rectified:
            sides.append(RawCamera(image_size, K, "", np.empty(0)))
        else:
            distortion = np.array(D) * (1 + 0.005 * off)
            sides.append(RawCamera(image_size, K, "plumb_bob", distortion))
    turn = np.zeros(3) if rectified else np.array([0.006, -0.011, 0.004])
    T_left_right = np.eye(4)
    T_left_right[:3, :3] = se3.exp_rotation(turn)
    T_left_right[:3, 3] = [baseline, 0.0, 0.0]
    if not rectified:
        T_left_right[:3, 3] += baseline * np.array([0.0, 0.006, -0.008])
    return StereoRig(sides[0], sides[1], T_left_right, T_body_left)
