# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The one-frame warp of image points, with its derivatives.

An image point ``y = (u_left, u_right, v)`` is a ray and an inverse depth. When the body moves by
T, the homogeneous point ``(ray, inverse depth)`` moves by one rigid motion of the camera and is
divided by its new depth: smooth through zero disparity, where triangulation is not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core import se3
from vislam_ros.core.camera import StereoCamera

Array = NDArray[np.float64]

# A point whose depth shrinks to less than this share of its old one has passed the camera.
_MIN_DEPTH_RATIO = 0.05
# Square of the tangent of the widest angle at which a landmark is still followed, 63 degrees.
_MAX_RAY_SQUARED = 4.0


@dataclass(frozen=True)
class Warp:
    """Image points after a motion, and how they depend on what was before.

    Attributes
    ----------
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)`` in the new frame, pixels.
    F_y : ndarray, (n, 3, 3)
        Derivative by the image point in the old frame.
    G : ndarray, (n, 3, 6)
        Derivative by the error ``[rho; theta]`` on the right of the body's motion.
    ahead : ndarray of bool, (n,)
        Whether the point still lies ahead of the camera and within the reach of a lens; the rest
        holds no meaning where not.
    """

    y: Array
    F_y: Array
    G: Array
    ahead: NDArray[np.bool_]


def warp(camera: StereoCamera, y: Array, T_old_new: Array) -> Warp:
    """Warp image points by the body's motion.

    Parameters
    ----------
    camera : StereoCamera
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)``, pixels.
    T_old_new : ndarray, (4, 4)
        The body's new pose in its old frame.
    """
    n = len(y)
    fx, fy, fxb = camera.fx, camera.fy, camera.fx_baseline
    T = camera.T_camera_body @ se3.inverse(T_old_new) @ camera.T_body_camera
    R, t = T[:3, :3], T[:3, 3]
    ray, inverse_depth = camera.rays(y)
    moved = ray @ R.T + inverse_depth[:, None] * t
    ahead = _can_be_seen(camera, moved, inverse_depth)
    if not ahead.all():
        # To infinity, straight ahead, where all numbers stay finite.
        moved[~ahead] = (0.0, 0.0, 1.0)
        inverse_depth[~ahead] = 0.0
    w = 1.0 / moved[:, 2]
    # In pixels from the principal point.
    offset = np.empty((n, 3))
    offset[:, 0] = fx * moved[:, 0] * w
    offset[:, 1] = offset[:, 0] - fxb * inverse_depth * w
    offset[:, 2] = fy * moved[:, 1] * w

    # By the moved ray: the projection's derivative.
    J = np.zeros((n, 3, 3))
    J[:, 0, 0] = J[:, 1, 0] = fx * w
    J[:, 2, 1] = fy * w
    np.multiply(offset, -w[:, None], out=J[:, :, 2])
    # Of the moved ray by (u_left, u_right, v), and of u_right by the disparity itself.
    F_y = J @ np.column_stack([R[:, 0] / fx + t / fxb, -t / fxb, R[:, 1] / fy])
    F_y[:, 1, 0] -= w
    F_y[:, 1, 1] += w
    # Exp(xi) on the right of the motion moves the ray by -(inverse depth rho + theta x ray),
    # with xi in camera axes.
    G = np.empty((n, 3, 6))
    np.multiply(J, -inverse_depth[:, None, None], out=G[:, :, :3])
    np.matmul(J, se3.hat(moved), out=G[:, :, 3:])
    G = (G.reshape(3 * n, 6) @ camera.camera_from_body_twist).reshape(n, 3, 6)
    offset += (camera.cx, camera.cx, camera.cy)
    return Warp(offset, F_y, G, ahead)


def _can_be_seen(camera: StereoCamera, moved: Array, inverse_depth: Array) -> NDArray[np.bool_]:
    """Tell which rays (n, 3), of old depth 1, both cameras still have before them."""
    depth = moved[:, 2]
    left, row = moved[:, 0], moved[:, 1]
    right = left - camera.baseline * inverse_depth
    across = np.maximum(left * left, right * right) + row * row
    return (depth > _MIN_DEPTH_RATIO) & (across < _MAX_RAY_SQUARED * depth * depth)
