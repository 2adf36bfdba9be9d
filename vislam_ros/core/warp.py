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
from vislam_ros.core.lens import corrected, distorted

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
    by_kappa : ndarray, (n, 3)
        Derivative by the lens's distortion.
    ahead : ndarray of bool, (n,)
        Whether the point still lies ahead of the camera and within the reach of a lens; the rest
        holds no meaning where not.
    """

    y: Array
    F_y: Array
    G: Array
    by_kappa: Array
    ahead: NDArray[np.bool_]


def warp(camera: StereoCamera, y: Array, T_old_new: Array, kappa: float = 0.0) -> Warp:
    """Warp image points by the body's motion.

    Parameters
    ----------
    camera : StereoCamera
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)``, pixels.
    T_old_new : ndarray, (4, 4)
        The body's new pose in its old frame.
    kappa : float
        What is left of the lens's radial distortion (see lens).
    """
    straight, by_y, shift = corrected(camera, y, kappa)
    warped = _warp_straight(camera, straight, T_old_new)
    # The lens's polynomial holds for what a camera can see; far outside it folds.
    r2 = ((warped.y - [camera.cx, camera.cx, camera.cy]) / [camera.fx, camera.fx, camera.fy]) ** 2
    in_reach = np.max(r2[:, :2], axis=1) + r2[:, 2] < _MAX_RAY_SQUARED
    warped.y[~in_reach] = (camera.cx, camera.cx, camera.cy)
    y_new, by_straight, by_kappa = distorted(camera, warped.y, kappa)
    by_old = by_straight @ warped.F_y
    return Warp(
        y=y_new,
        F_y=by_old @ by_y,
        G=by_straight @ warped.G,
        by_kappa=(by_old @ shift[..., None])[..., 0] + by_kappa,
        ahead=warped.ahead & in_reach,
    )


def _warp_straight(camera: StereoCamera, y: Array, T_old_new: Array) -> Warp:
    """Warp image points that no lens distorts."""
    T = camera.T_camera_body @ se3.inverse(T_old_new) @ camera.T_body_camera
    R, t = T[:3, :3], T[:3, 3]
    fx, fy, fxb = camera.fx, camera.fy, camera.fx_baseline
    ray, inverse_depth = camera.rays(y)
    moved = ray @ R.T + inverse_depth[:, None] * t
    ahead = moved[:, 2] > _MIN_DEPTH_RATIO
    moved[~ahead] = (0.0, 0.0, 1.0)
    w = 1.0 / moved[:, 2]
    y_new = np.empty_like(y)
    y_new[:, 0] = fx * moved[:, 0] * w + camera.cx
    y_new[:, 1] = y_new[:, 0] - fxb * inverse_depth * w
    y_new[:, 2] = fy * moved[:, 1] * w + camera.cy

    # By the moved ray: the projection's derivative.
    J = np.zeros((len(y), 3, 3))
    J[:, 0, 0] = J[:, 1, 0] = fx * w
    J[:, 0, 2] = -(y_new[:, 0] - camera.cx) * w
    J[:, 1, 2] = -(y_new[:, 1] - camera.cx) * w
    J[:, 2, 1] = fy * w
    J[:, 2, 2] = -(y_new[:, 2] - camera.cy) * w
    # Of the moved ray by (u_left, u_right, v), and of u_right by the disparity itself.
    by_y = np.column_stack([R[:, 0] / fx + t / fxb, -t / fxb, R[:, 1] / fy])
    F_y = J @ by_y
    F_y[:, 1, 0] -= w
    F_y[:, 1, 1] += w
    # Exp(xi) on the right of the motion moves the ray by -(inverse depth rho + theta x ray),
    # with xi in camera axes.
    by_motion = np.empty((len(y), 3, 6))
    by_motion[:, :, :3] = -inverse_depth[:, None, None] * np.eye(3)
    by_motion[:, :, 3:] = se3.hat(moved)
    G = J @ (by_motion @ se3.adjoint(camera.T_camera_body))
    return Warp(y_new, F_y, G, np.zeros_like(y), ahead)
