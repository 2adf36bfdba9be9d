# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What rectification has left of the lens's radial distortion.

A rectified pixel s at the normalised point (x, y) should stand at ``s + kappa D(s)`` with ``D = f
(x, y) r^2``. On the KITTI drives kappa is about -0.013: a yaw seen in the image reads 1 % long
(compare Kreso and Segvic, *Improving the egomotion estimation by correcting the calibration
bias*, VISAPP 2015).
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.camera import StereoCamera

Array = NDArray[np.float64]


def radial_shift(camera: StereoCamera, y: Array) -> tuple[Array, Array]:
    """Shift of image points for a unit of distortion, and its derivative.

    Parameters
    ----------
    camera : StereoCamera
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)``, pixels. The row, which both images share, takes the mean of both
        images' shifts.

    Returns
    -------
    D : ndarray, (n, 3)
        Pixels.
    J : ndarray, (n, 3, 3)
        Derivative of D by the image point.
    """
    fx, fy = camera.fx, camera.fy
    left, right = (y[:, 0] - camera.cx) / fx, (y[:, 1] - camera.cx) / fx
    row = (y[:, 2] - camera.cy) / fy
    r2_left, r2_right = left**2 + row**2, right**2 + row**2
    r2_mean = 0.5 * (r2_left + r2_right)
    D = np.column_stack([fx * left * r2_left, fx * right * r2_right, fy * row * r2_mean])
    J = np.zeros((len(y), 3, 3))
    J[:, 0, 0] = r2_left + 2 * left**2
    J[:, 0, 2] = 2 * left * row * fx / fy
    J[:, 1, 1] = r2_right + 2 * right**2
    J[:, 1, 2] = 2 * right * row * fx / fy
    J[:, 2, 0] = left * row * fy / fx
    J[:, 2, 1] = right * row * fy / fx
    J[:, 2, 2] = r2_mean + 2 * row**2
    return D, J


def corrected(camera: StereoCamera, y: Array, kappa: float) -> tuple[Array, Array, Array]:
    """Image points without distortion.

    Returns
    -------
    c : ndarray, (n, 3)
        ``y + kappa D(y)``, pixels.
    by_y : ndarray, (n, 3, 3)
        Derivative by the image point.
    by_kappa : ndarray, (n, 3)
        Derivative by kappa.
    """
    D, J = radial_shift(camera, y)
    return y + kappa * D, np.eye(3) + kappa * J, D


def distorted(camera: StereoCamera, c: Array, kappa: float) -> tuple[Array, Array, Array]:
    """Image points (n, 3) that :func:`corrected` takes to ``c``, and their derivatives.

    Returns
    -------
    y : ndarray, (n, 3)
        Pixels.
    by_c : ndarray, (n, 3, 3)
        Derivative by c.
    by_kappa : ndarray, (n, 3)
        Derivative by kappa.
    """
    y = c
    # Newton's method; the shift is some pixels, so that three rounds are exact to rounding.
    for _ in range(3):
        D, J = radial_shift(camera, y)
        y = y - np.linalg.solve(np.eye(3) + kappa * J, (y + kappa * D - c)[..., None])[..., 0]
    D, J = radial_shift(camera, y)
    by_c = np.linalg.inv(np.eye(3) + kappa * J).astype(float)
    return y, by_c, -(by_c @ D[..., None])[..., 0]
