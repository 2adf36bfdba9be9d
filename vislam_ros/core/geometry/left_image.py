# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The warp as the left image alone sees it, of many points at once and not compiled.

It is :func:`vislam_ros.core.geometry.warp.warp` for those who look at a whole drive once: numpy is
as fast there, and the compiler takes longer to import than a drive to read.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

# A point whose depth shrinks to less than this share of its old one has passed the camera.
MIN_DEPTH_RATIO = 0.05
# Square of the tangent of the widest angle at which a landmark is still followed, 63 degrees.
MAX_RAY_SQUARED = 4.0


class LeftWarp(NamedTuple):
    """Points in the left image after a motion, and how they depend on what was before.

    Attributes
    ----------
    y : ndarray, (n, 2)
        ``(u_left, v)`` in the new frame, pixels.
    F_y : ndarray, (n, 2, 3)
        Derivative by ``(u_left, u_right, v)`` in the old frame.
    G : ndarray, (n, 2, 6)
        Derivative by the error ``[rho; theta]`` on the right of the body's motion.
    ahead : ndarray of bool, (n,)
        Whether both cameras still see the point; the rest holds no meaning where not.
    """

    y: Array
    F_y: Array
    G: Array
    ahead: NDArray[np.bool_]


def left_warp(camera: StereoCamera, y: Array, T_old_new: Array) -> LeftWarp:
    """Warp image points (n, 3) by a motion of the body each, (n, 4, 4) or one (4, 4)."""
    T = camera.T_camera_body @ se3.inverse(T_old_new) @ camera.T_body_camera
    R, t = T[..., :3, :3], T[..., :3, 3]
    ray, inverse_depth = camera.rays(y)
    moved = (R @ ray[..., None])[..., 0] + t * inverse_depth[:, None]
    right = moved[:, 0] - camera.fx_baseline / camera.fx * inverse_depth
    across = np.maximum(moved[:, 0] ** 2, right**2) + moved[:, 1] ** 2
    ahead = (moved[:, 2] > MIN_DEPTH_RATIO) & (across < MAX_RAY_SQUARED * moved[:, 2] ** 2)
    moved[~ahead] = (0.0, 0.0, 1.0)
    w = 1.0 / moved[:, 2]
    focal = np.array([camera.fx, camera.fy])
    centred = focal * moved[:, :2] * w[:, None]
    J = np.zeros((len(y), 2, 3))
    J[:, 0, 0], J[:, 1, 1] = camera.fx * w, camera.fy * w
    J[:, :, 2] = -centred * w[:, None]
    by_point = np.empty((len(y), 3, 3))
    by_point[:, :, 1] = -t / camera.fx_baseline
    by_point[:, :, 0] = R[..., 0] / camera.fx - by_point[:, :, 1]
    by_point[:, :, 2] = R[..., 1] / camera.fy
    # Exp(xi) on the right of the motion moves the ray by -(inverse depth rho + theta x ray).
    by_twist = np.concatenate([-inverse_depth[:, None, None] * J, J @ se3.hat(moved)], axis=2)
    return LeftWarp(
        centred + np.array([camera.cx, camera.cy]),
        J @ by_point,
        by_twist @ camera.camera_from_body_twist,
        ahead,
    )
