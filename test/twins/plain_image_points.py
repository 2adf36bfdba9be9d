# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Image points, their warp and their positions as plain functions of real or complex numbers.

Complex steps differentiate them to rounding, without a formula of a derivative.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]
# Real or complex.
Complex = NDArray[Any]

# u_left, v_left, u_right and v_right of (u_left, u_right, v).
FOUR_ROWS = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]])


def noise_of_image_points(V: Array) -> Array:
    """Covariance (3, 3) of ``(u_left, u_right, v)`` from pixels with a noise of V (4, 4)."""
    return np.linalg.inv(FOUR_ROWS.T @ np.linalg.inv(V) @ FOUR_ROWS)


def image_points_of(pixels: Array, V: Array) -> Array:
    """Best ``(u_left, u_right, v)`` (n, 3) of pixels (n, 4) with a noise of V (4, 4)."""
    return pixels @ np.linalg.inv(V) @ FOUR_ROWS @ noise_of_image_points(V)


def twist_matrix(xi: Complex) -> Complex:
    """Matrix (4, 4) of ``[rho; theta]`` in se(3)."""
    (a, b, c), (x, y, z) = xi[:3], xi[3:]
    return np.array([[0, -z, y, a], [z, 0, -x, b], [-y, x, 0, c], [0, 0, 0, 0]], dtype=complex)


def shift(camera: StereoCamera, y: Complex) -> Complex:
    """Shift (n, 3) of image points for a unit of radial distortion (see lens)."""
    left, right = (y[:, :2].T - camera.cx) / camera.fx
    row = (y[:, 2] - camera.cy) / camera.fy
    r2_left, r2_right = left**2 + row**2, right**2 + row**2
    return np.column_stack(
        [
            camera.fx * left * r2_left,
            camera.fx * right * r2_right,
            camera.fy * row * (r2_left + r2_right) / 2,
        ]
    )


def homogeneous(camera: StereoCamera, straight: Complex) -> Complex:
    """Points (n, 4) in the left camera, ``(x / z, y / z, 1, 1 / z)``."""
    ones = np.ones(len(straight))
    return np.column_stack(
        [
            (straight[:, 0] - camera.cx) / camera.fx,
            (straight[:, 2] - camera.cy) / camera.fy,
            ones,
            (straight[:, 0] - straight[:, 1]) / camera.fx_baseline,
        ]
    )


def warped(
    camera: StereoCamera, y: Complex, twist: Complex, tau: float
) -> tuple[Complex, NDArray[np.bool_]]:
    """Image points (n, 3) after a motion, and which of them are still well ahead."""
    moved = (
        homogeneous(camera, y)
        @ (camera.T_camera_body @ expm(-tau * twist_matrix(twist)) @ camera.T_body_camera).T
    )
    ahead = moved[:, 2].real > 0.05
    moved[~ahead] = (0.0, 0.0, 1.0, 0.0)
    x, v, w = moved[:, 0] / moved[:, 2], moved[:, 1] / moved[:, 2], moved[:, 3] / moved[:, 2]
    u = camera.fx * x + camera.cx
    return np.column_stack([u, u - camera.fx_baseline * w, camera.fy * v + camera.cy]), ahead


def world_positions(camera: StereoCamera, T_world_body: Complex, y: Complex) -> Complex:
    """World positions (n, 3) of image points."""
    points = homogeneous(camera, y) @ (T_world_body @ camera.T_body_camera).T
    return points[:, :3] / points[:, 3:]


def complex_step(f: Callable[[Complex], Complex], x: Array) -> Array:
    """Derivative (..., m) of a function (...) by x (m,), exact to rounding."""
    h = 1e-30
    steps = 1j * h * np.eye(len(x))
    return np.stack([f(x + step).imag / h for step in steps], axis=-1)


def pose_transition(twist: Array, tau: float) -> Array:
    """Derivative (6, 12) of the pose's error after tau seconds by that before and the twist's."""
    back = np.linalg.inv(expm(tau * twist_matrix(twist)))

    def error(x: Complex) -> Complex:
        E = back @ expm(twist_matrix(x[:6])) @ expm(tau * twist_matrix(twist + x[6:]))
        return np.array([E[0, 3], E[1, 3], E[2, 3], E[2, 1], E[0, 2], E[1, 0]])

    return complex_step(error, np.zeros(12))
