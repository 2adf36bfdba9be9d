# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What rectification has left of the lens's radial distortion.

A rectified pixel z at the normalised point (x, y) should stand at ``z + kappa D(z)`` with ``D = f
(x, y) r^2``. On the KITTI drives kappa is about -0.013: a yaw seen in the image reads 1 % long
(compare Kreso and Segvic, *Improving the egomotion estimation by correcting the calibration
bias*, VISAPP 2015).
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]


def radial_shift(camera: StereoCamera, y: Array) -> Array:
    """Shift D (n, 3) of image points (n, 3) for a unit of distortion, pixels.

    The row, which both images share, takes the mean of both images' shifts.
    """
    return _shifts(y, camera.fx, camera.fy, camera.cx, camera.cy)


@compiled("float64[:, ::1](float64[:, :], float64, float64, float64, float64)")
def _shifts(points: Array, fx: float, fy: float, cx: float, cy: float) -> Array:
    D = np.empty(points.shape)
    for i in range(len(points)):
        left, right = (points[i, 0] - cx) / fx, (points[i, 1] - cx) / fx
        row = (points[i, 2] - cy) / fy
        r2_left, r2_right = left * left + row * row, right * right + row * row
        D[i, 0] = fx * left * r2_left
        D[i, 1] = fx * right * r2_right
        D[i, 2] = 0.5 * fy * row * (r2_left + r2_right)
    return D
