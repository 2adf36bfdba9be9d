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

from vislam_ros.core.compiled import compiled
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.left_image import MAX_RAY_SQUARED, MIN_DEPTH_RATIO

Array = NDArray[np.float64]

# Told where they need no compiler.
_MIN_DEPTH_RATIO, _MAX_RAY_SQUARED = MIN_DEPTH_RATIO, MAX_RAY_SQUARED


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
    T_old_new : ndarray, (4, 4) or (n, 4, 4)
        The body's new pose in its old frame, one for all points or one for each.
    """
    T = camera.T_camera_body @ se3.inverse(T_old_new) @ camera.T_body_camera
    T = T.reshape(-1, 4, 4)
    Ad = camera.camera_from_body_twist
    return Warp(*_warped(y, T, Ad, camera.fx, camera.fy, camera.cx, camera.cy, camera.fx_baseline))


@compiled("boolean(float64[::1], float64)")
def _can_be_seen(moved: Array, shift: float) -> bool:
    """Tell whether both cameras still have a ray (3,), of old depth 1, before them.

    The shift is the baseline in units of the old depth.
    """
    left, row, depth = moved[0], moved[1], moved[2]
    right = left - shift
    across = max(left * left, right * right) + row * row
    return bool(depth > _MIN_DEPTH_RATIO and across < _MAX_RAY_SQUARED * depth * depth)


@compiled(
    "Tuple((float64[:, ::1], float64[:, :, ::1], float64[:, :, ::1], boolean[::1]))"
    "(float64[:, :], float64[:, :, ::1], float64[:, ::1], float64, float64, float64, float64,"
    " float64)"
)
def _warped(
    points: Array,
    motions: Array,
    Ad: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    fxb: float,
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Warp points by motions (1 or n, 4, 4) of the left camera.

    Ad brings a body twist into its axes.
    """
    n = len(points)
    y, F_y, G = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 6))
    ahead = np.empty(n, dtype=np.bool_)
    moved, J, by_twist = np.empty(3), np.zeros((3, 3)), np.empty(6)
    # Of the moved ray by (u_left, u_right, v).
    by_point = np.empty((3, 3))
    T = motions[0]
    for i in range(n):
        if i < len(motions):
            T = motions[i]
            for k in range(3):
                by_point[k, 0] = T[k, 0] / fx + T[k, 3] / fxb
                by_point[k, 1] = -T[k, 3] / fxb
                by_point[k, 2] = T[k, 1] / fy
        x, row = (points[i, 0] - cx) / fx, (points[i, 2] - cy) / fy
        inverse_depth = (points[i, 0] - points[i, 1]) / fxb
        for k in range(3):
            moved[k] = T[k, 0] * x + T[k, 1] * row + T[k, 2] + T[k, 3] * inverse_depth
        ahead[i] = _can_be_seen(moved, fxb / fx * inverse_depth)
        if not ahead[i]:
            # To infinity, straight ahead, where all numbers stay finite.
            moved[0], moved[1], moved[2], inverse_depth = 0.0, 0.0, 1.0, 0.0
        w = 1.0 / moved[2]
        # In pixels from the principal point.
        left, down = fx * moved[0] * w, fy * moved[1] * w
        right = left - fxb * inverse_depth * w
        y[i, 0], y[i, 1], y[i, 2] = left + cx, right + cx, down + cy
        # By the moved ray: the projection's derivative.
        J[0, 0] = J[1, 0] = fx * w
        J[2, 1] = fy * w
        J[0, 2], J[1, 2], J[2, 2] = -left * w, -right * w, -down * w
        for r in range(3):
            for c in range(3):
                F_y[i, r, c] = (
                    J[r, 0] * by_point[0, c] + J[r, 1] * by_point[1, c] + J[r, 2] * by_point[2, c]
                )
            # Exp(xi) on the right of the motion moves the ray by -(inverse depth rho + theta x
            # ray), with xi in camera axes.
            for c in range(3):
                by_twist[c] = -inverse_depth * J[r, c]
            by_twist[3] = J[r, 1] * moved[2] - J[r, 2] * moved[1]
            by_twist[4] = J[r, 2] * moved[0] - J[r, 0] * moved[2]
            by_twist[5] = J[r, 0] * moved[1] - J[r, 1] * moved[0]
            for c in range(6):
                G[i, r, c] = 0.0
                for k in range(6):
                    G[i, r, c] += by_twist[k] * Ad[k, c]
        # And of u_right by the disparity itself.
        F_y[i, 1, 0] -= w
        F_y[i, 1, 1] += w
    return y, F_y, G, ahead
