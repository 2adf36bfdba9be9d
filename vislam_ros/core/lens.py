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

from vislam_ros.core.camera import StereoCamera

Array = NDArray[np.float64]


def radial_shift(camera: StereoCamera, y: Array) -> Array:
    """Shift D (n, 3) of image points (n, 3) for a unit of distortion, pixels.

    The row, which both images share, takes the mean of both images' shifts.
    """
    columns = (y[:, :2] - camera.cx) / camera.fx
    row = (y[:, 2] - camera.cy) / camera.fy
    r2 = columns * columns + (row * row)[:, None]
    D = np.empty_like(y)
    D[:, :2] = camera.fx * columns * r2
    D[:, 2] = 0.5 * camera.fy * row * (r2[:, 0] + r2[:, 1])
    return D
