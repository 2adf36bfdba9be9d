# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter's vehicle state: which component of its error is what, and its prior."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.settings import SlamSettings

Array = NDArray[np.float64]

# Pose [rho; theta], twist [v; omega], bias of the gyroscope, bias of the velocity's y and z, lens.
POSE, TWIST, GYRO_BIAS, VELOCITY_BIAS = slice(0, 6), slice(6, 12), slice(12, 15), slice(15, 17)
LENS = 17
SIZE = 18

# What a landmark's position in the world depends on besides its image point: pose and lens.
POSE_AND_LENS = np.array([0, 1, 2, 3, 4, 5, LENS])

# Before the first motion nothing is known of the twist but that it is a vehicle's.
_FIRST_TWIST_STD = np.array([50.0, 50.0, 50.0, 2.0, 2.0, 2.0])


def prior_covariance(settings: SlamSettings) -> Array:
    """Covariance (18, 18) of the vehicle state before the first frame."""
    variances = np.empty(SIZE)
    variances[POSE] = settings.prior_pose_variance
    variances[TWIST] = _FIRST_TWIST_STD**2
    variances[GYRO_BIAS] = settings.gyro_bias_std**2
    variances[VELOCITY_BIAS] = settings.velocity_bias_std**2
    variances[LENS] = settings.lens_distortion_std**2
    return np.diag(variances)


def walk_covariance(settings: SlamSettings, twist_walk_variance: Array, tau: float) -> Array:
    """Covariance Q (18, 18) of what the vehicle state changes by in tau seconds.

    Parameters
    ----------
    settings : SlamSettings
    twist_walk_variance : ndarray, (6,)
        Of the twist's change in a second.
    tau : float
    """
    variances = np.zeros(SIZE)
    variances[TWIST] = tau * twist_walk_variance
    variances[GYRO_BIAS] = tau * settings.gyro_bias_walk_std**2
    variances[VELOCITY_BIAS] = tau * settings.velocity_bias_walk_std**2
    return np.diag(variances)
