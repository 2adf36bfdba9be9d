# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The models of the robocentric filter: vehicle state, random walk, measured twist and motion.

*Twist.* The prediction's mean twist over a step is ``z = [v + b_v; omega + b_g] + n``. The
velocity's direction is off by a slow error on real vehicles (b_v, lateral and vertical: on
KITTI-360 by up to 5 degrees). A vehicle goes where it points but for some slip, the more where it
turns and the body's origin is not on the axle that follows: its lateral and vertical velocities
are measured as zero.

*Motion.* With ``T <- T Exp(tau u)`` and ``y <- w(y, Exp(tau u))`` the errors go over by ::

    pose      Ad(Exp(-tau u)) xi + tau J_r delta_u
    landmark  F_y delta_y + tau G J_r delta_u + (F_y D(y) - D(y+)) delta_kappa

where J_r is the right Jacobian at ``tau u``, F_y and G are those of the warp, and D is the shift
of the lens, which a landmark's error is kept apart from (see lens). The pose's part is the
report's eq. 13 and 52, with the twist in the state.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.warp import Warp
from vislam_ros.core.motion import FIRST_TWIST_STD
from vislam_ros.core.operations.correction import VehicleCorrection
from vislam_ros.core.operations.transition import Transition

Array = NDArray[np.float64]

# The vehicle state: pose [rho; theta], twist [v; omega], gyroscope bias, velocity bias, lens.
POSE, TWIST, GYRO_BIAS, VELOCITY_BIAS = slice(0, 6), slice(6, 12), slice(12, 15), slice(15, 17)
LENS = 17
SIZE = 18

# What a landmark's position in the world depends on besides its image point: pose and lens.
POSE_AND_LENS = np.array([0, 1, 2, 3, 4, 5, LENS])

# The lateral and vertical velocity, in a twist and in the vehicle state.
_LATERAL_VERTICAL, _STATE_LATERAL_VERTICAL = slice(1, 3), slice(7, 9)
# The turn rates that move a place ahead of the origin laterally and vertically: yaw and pitch.
_YAW_PITCH = np.array([5, 4])


def prior_covariance(settings: RobocentricSettings) -> Array:
    """Covariance (18, 18) of the vehicle state before the first frame."""
    variances = np.empty(SIZE)
    variances[POSE] = settings.prior_pose_variance
    variances[TWIST] = FIRST_TWIST_STD**2
    variances[GYRO_BIAS] = settings.gyro_bias_std**2
    variances[VELOCITY_BIAS] = settings.velocity_bias_std**2
    variances[LENS] = settings.lens_distortion_std**2
    return np.diag(variances)


def walk_densities(settings: RobocentricSettings) -> Array:
    """Variances (18,) of what the vehicle state changes by in a second, the twist left out."""
    densities = np.zeros(SIZE)
    densities[GYRO_BIAS] = settings.gyro_bias_walk_std**2
    densities[VELOCITY_BIAS] = settings.velocity_bias_walk_std**2
    return densities


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


def transition_of(
    camera: StereoCamera, y: Array, warped: Warp, motion: Array, twist: Array, tau: float
) -> Transition:
    """F of a motion (4, 4), tau seconds at a twist (6,), that has warped image points (n, 3)."""
    by_twist = tau * se3.right_jacobian(tau * twist)
    vehicle = np.eye(SIZE)
    vehicle[POSE, POSE] = se3.adjoint(se3.inverse(motion))
    vehicle[POSE, TWIST] = by_twist
    shift, shift_new = radial_shift(camera, y), radial_shift(camera, warped.y)
    coupling = _coupling(warped.G, by_twist, warped.F_y, shift, shift_new)
    return Transition(vehicle, warped.F_y, coupling)


@compiled(
    "float64[:, :, ::1](float64[:, :, ::1], float64[:, :], float64[:, :, ::1], float64[:, ::1],"
    " float64[:, ::1])"
)
def _coupling(G: Array, by_twist: Array, F_y: Array, shift: Array, shift_new: Array) -> Array:
    """How warped points (n, 3) depend on the vehicle state but the pose: on twist and lens."""
    n = len(G)
    coupling = np.zeros((n, 3, SIZE - 6))
    for i in range(n):
        for r in range(3):
            for c in range(6):
                for k in range(6):
                    coupling[i, r, c] += G[i, r, k] * by_twist[k, c]
            for k in range(3):
                coupling[i, r, -1] += F_y[i, r, k] * shift[i, k]
            coupling[i, r, -1] -= shift_new[i, r]
    return coupling
