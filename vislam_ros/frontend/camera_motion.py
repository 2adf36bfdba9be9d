# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion of the camera that most points agree on, and how it warps what is about them.

Each point has a depth by its disparity, so three of them tell a pose (P3P) whether the camera
stands, turns or drives, and whatever the shape of the scene: the fundamental matrix, which knows
no depths, has no answer for a camera that stands or only turns.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.se3 import inverse
from vislam_ros.core.geometry.warp import warp

Array = NDArray[np.float64]

# Fewer points than these tell no motion that three of them could not have made up.
_FEWEST_POINTS = 8
# Share of the points that must agree; P3P finds three good ones of so few in _TRIALS trials.
_SMALLEST_SHARE = 0.4
_TRIALS, _CONFIDENCE = 100, 0.999
# Points farther away than this disparity [px] are as good as at infinity, for which P3P has no
# numbers: what moves the camera by its baseline moves them by a twentieth of a pixel.
_FARTHEST = 0.05


def camera_motion(
    camera: StereoCamera, before: Array, now: NDArray[np.float32], tolerance: float
) -> Array | None:
    """Motion of the left camera between two images.

    Parameters
    ----------
    camera : StereoCamera
    before : ndarray, (n, 3)
        ``(u_left, u_right, v)`` of points, pixels.
    now : ndarray of float32, (n, 2)
        Where they are in the left image now, pixels.
    tolerance : float
        How far a point may be from where the motion takes it, pixels.

    Returns
    -------
    ndarray, (4, 4), or None
        ``T_now_before``; None where too few points agree on one.
    """
    if len(before) < _FEWEST_POINTS:
        return None
    ray, inverse_depth = camera.rays(before)
    points = ray / np.maximum(inverse_depth, _FARTHEST / camera.fx_baseline)[:, None]
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    seen = now.astype(float)
    try:
        found, turn, shift, chosen = cv2.solvePnPRansac(
            points,
            seen,
            K,
            None,
            iterationsCount=_TRIALS,
            reprojectionError=tolerance,
            confidence=_CONFIDENCE,
            flags=cv2.SOLVEPNP_AP3P,
        )
        if not found or len(chosen) < max(_FEWEST_POINTS, _SMALLEST_SHARE * len(before)):
            return None
        chosen = chosen.ravel()
        turn, shift = cv2.solvePnPRefineLM(points[chosen], seen[chosen], K, None, turn, shift)
    except cv2.error:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(shift)
    return T if np.all(np.isfinite(T)) else None


def moved(
    camera: StereoCamera, before: Array, slopes: NDArray[np.float32], T_now_before: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Where a motion takes points, and what is about them.

    Parameters
    ----------
    camera : StereoCamera
    before : ndarray, (n, 3)
        ``(u_left, u_right, v)``, pixels.
    slopes : ndarray, (n, 2)
        How ``u_right - u_left`` grows along u and v: the surface's tilt.
    T_now_before : ndarray, (4, 4)

    Returns
    -------
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)`` after the motion.
    maps : ndarray, (n, 2, 2)
        From a step in the left image of before to the step in that of now.
    ahead : ndarray of bool, (n,)
        Whether the point lies ahead of the camera, and the surface still shows its front.
    """
    T_old_new = camera.T_body_camera @ inverse(T_now_before) @ camera.T_camera_body
    warped = warp(camera, before, T_old_new)
    # A step along u takes u_right along by 1 + slope, and a step along v by the other slope.
    F = warped.F_y[:, [0, 2]]
    maps = np.empty((len(before), 2, 2))
    maps[..., 0] = F[..., 0] + (1 + slopes[:, :1]) * F[..., 1]
    maps[..., 1] = F[..., 2] + slopes[:, 1:] * F[..., 1]
    with np.errstate(invalid="ignore"):
        ahead = warped.ahead & (np.linalg.det(maps) > 0)
    maps[~ahead] = np.eye(2)
    return warped.y, maps, ahead
