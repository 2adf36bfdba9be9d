# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""In which other ways the extrinsics and the axes of a twist may be meant.

Each reading takes a measured twist of the body to the twist of the left camera in its optical
axes, with the calibration as it was given. All are ways in which files and drivers are known to
differ from what is expected here.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

# Optical axes (right, down, forward) in a camera's forward-left-up axes.
_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_USUAL = "twists in forward-right-down axes"
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


class Reading(NamedTuple):
    """A way to read extrinsics and twists.

    Attributes
    ----------
    words : str
        What is to be done to what was given.
    camera_from_twist : ndarray, (6, 6)
        Twist of the camera by the measured twist of the body.
    """

    words: str
    camera_from_twist: Array


def as_given(camera: StereoCamera) -> Array:
    """What every reading gives, (6, 6), with all as it was given."""
    return camera.camera_from_body_twist


def other_readings(camera: StereoCamera) -> tuple[list[Reading], list[Reading]]:
    """Return those that change one thing, and those that change two.

    Of the latter only those of wrong extrinsics and the most usual other axes of a twist: two
    turns of axes can nearly cancel, and would fit a camera that is a little askew.
    """
    T = camera.T_body_camera
    extrinsics = {
        "": T,
        "T_body_camera inverted": se3.inverse(T),
        "T_body_camera as to forward-left-up camera axes": T @ _OPTICAL,
        "T_body_camera inverted, as to forward-left-up camera axes": se3.inverse(T) @ _OPTICAL,
    }
    twists = {
        "": np.eye(6),
        _USUAL: se3.adjoint(_HALF_TURN),
        "twists in optical axes (x right, y down, z forward)": se3.adjoint(_OPTICAL),
        "angular velocities of the other sign": np.diag([1.0, 1, 1, -1, -1, -1]),
        "velocities of the other sign": np.diag([-1.0, -1, -1, 1, 1, 1]),
    }
    readings: tuple[list[Reading], list[Reading]] = ([], [])
    for of_extrinsics, T_body_camera in extrinsics.items():
        for of_twists, body_from_twist in twists.items():
            words = [words for words in (of_extrinsics, of_twists) if words]
            if words and (len(words) < 2 or of_twists == _USUAL):
                camera_from_twist = se3.adjoint(se3.inverse(T_body_camera)) @ body_from_twist
                readings[len(words) - 1].append(Reading(" and ".join(words), camera_from_twist))
    return readings
