# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the robocentric filter takes the prediction's mean twist for.

``z = [v + b_v; omega + b_g] + n``. The velocity's direction is off by a slow error on real
vehicles (b_v, lateral and vertical: on KITTI-360 by up to 5 degrees). A vehicle goes where it
points but for some slip, the more where it turns and the body's origin is not on the axle that
follows: its lateral and vertical velocities are measured as zero.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.vehicle_state import GYRO_BIAS, SIZE, TWIST, VELOCITY_BIAS
from vislam_ros.core.operations.correction import VehicleCorrection

Array = NDArray[np.float64]

# The lateral and vertical velocity, in a twist and in the vehicle state.
_LATERAL_VERTICAL, _STATE_LATERAL_VERTICAL = slice(1, 3), slice(7, 9)
# The turn rates that move a place ahead of the origin laterally and vertically: yaw and pitch.
_YAW_PITCH = np.array([5, 4])


class TwistMeasurement:
    """Measurement of the vehicle state by a twist.

    Parameters
    ----------
    slip_std : float
        White noise of the slip, m/s sqrt(s); 0 for a body that moves in any direction.
    axle_distance : float
        How far the origin is from the axle that follows, metres.

    Attributes
    ----------
    H : ndarray, (6 or 8, 18)
        Derivative of the twist, and of the slip, by the vehicle state.
    """

    def __init__(self, slip_std: float, axle_distance: float):
        self._slip_std = slip_std
        self._axle_distance = axle_distance
        H = np.zeros((8, SIZE))
        H[:6, TWIST] = np.eye(6)
        H[3:6, GYRO_BIAS] = np.eye(3)
        H[_LATERAL_VERTICAL, VELOCITY_BIAS] = np.eye(2)
        H[6:, _STATE_LATERAL_VERTICAL] = np.eye(2)
        self.H: Array = H if slip_std > 0 else H[:6]

    def error(
        self, measured: Array, twist: Array, gyro_bias: Array, velocity_bias: Array
    ) -> Array:
        """What a measured twist (6,) is off from the estimate, biases taken into account."""
        error = measured - twist
        error[_LATERAL_VERTICAL] -= velocity_bias
        error[3:] -= gyro_bias
        return error

    def correction(
        self, error: Array, variances: Array, twist: Array, tau: float
    ) -> VehicleCorrection:
        """Return the correction by a measured twist.

        Parameters
        ----------
        error : ndarray, (6,)
            What it is off.
        variances : ndarray, (6,)
            Of its noise.
        twist : ndarray, (6,)
            The estimate.
        tau : float
            The time that it is the mean of, seconds.
        """
        H = self.H
        slip_rows = len(H) - 6
        R, residual = np.empty(len(H)), np.empty(len(H))
        R[:6], R[6:] = variances, self._slip_std**2 / tau
        R[6:] += np.square(self._axle_distance * twist[_YAW_PITCH])[:slip_rows]
        residual[:6] = error
        residual[6:] = -twist[_LATERAL_VERTICAL][:slip_rows]
        return VehicleCorrection(residual, R, H)
