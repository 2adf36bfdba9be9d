# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The models of the robocentric filter: vehicle state, random walk, measured twist and motion.

The state, its random walk and what is observed are ::

    state  T, u, b, kappa, y_1 ... y_n: pose, twist, gyroscope's bias, lens, landmarks;
           T = T_hat Exp(xi), all other errors are differences
    Q      tau blkdiag(0, W_u, W_b, 0), a random walk of u and of the bias alone
    F      [ Ad(Exp(-tau u))  tau J_r      0  0                0           ]  xi
           [ 0                I            0  0                0           ]  delta_u
           [ 0                0            I  0                0           ]  delta_b
           [ 0                0            0  1                0           ]  delta_kappa
           [ 0                tau G_i J_r  0  F_i D_i - D_i+   blkdiag F_i ]  delta_y_i
    h, H   of the twist: [v; omega + b], [0 I B 0 0]; of the image: y, [0 I]

*Twist.* The prediction's mean twist over a step is ``z = [v; omega + b_g] + n``.

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
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.geometry.warp import Warp
from vislam_ros.core.motion import FIRST_TWIST_STD
from vislam_ros.core.noise.motion_noise import MotionNoise
from vislam_ros.core.operations.transition import Transition

Array = NDArray[np.float64]

# The vehicle state: pose [rho; theta], twist [v; omega], gyroscope bias, lens.
POSE, TWIST, GYRO_BIAS = slice(0, 6), slice(6, 12), slice(12, 15)
LENS = 15
SIZE = 16

# What a landmark's position in the world depends on besides its image point: pose and lens.
POSE_AND_LENS = np.array([0, 1, 2, 3, 4, 5, LENS])

#: Derivative (6, 16) of the measured twist by the vehicle state.
TWIST_ROWS: Array = np.zeros((6, SIZE))
TWIST_ROWS[:, TWIST] = np.eye(6)
TWIST_ROWS[3:, GYRO_BIAS] = np.eye(3)

# How far a twist may be off that vision contradicts, in standard deviations.
_DOUBT = 10.0


def prior_covariance(settings: RobocentricSettings) -> Array:
    """Covariance (16, 16) of the vehicle state before the first frame."""
    variances = np.empty(SIZE)
    variances[POSE] = settings.prior_pose_variance
    variances[TWIST] = FIRST_TWIST_STD**2
    variances[GYRO_BIAS] = settings.gyro_bias_std**2
    variances[LENS] = settings.lens_distortion_std**2
    return np.diag(variances)


def doubt_of_twist(covariance: Array) -> Array:
    """Covariance (16, 16) to add to the vehicle state's, (16, 16), where vision contradicts it.

    The twist may be off by ten times its standard deviations then, and no more than at the start.
    """
    doubted = np.minimum(_DOUBT**2 * covariance.diagonal()[TWIST], FIRST_TWIST_STD**2)
    doubt = np.zeros((SIZE, SIZE))
    doubt[TWIST, TWIST] = np.diag(np.maximum(doubted - covariance.diagonal()[TWIST], 0.0))
    return doubt


def walk_densities(settings: RobocentricSettings) -> Array:
    """Variances (16,) of what the vehicle state changes by in a second, the twist left out."""
    densities = np.zeros(SIZE)
    densities[GYRO_BIAS] = settings.gyro_bias_walk_std**2
    return densities


def motion_priors(settings: RobocentricSettings) -> tuple[Array, Array]:
    """Noise (6,) of a measured twist and random walk (6,) of the twist, standard deviations."""
    noise = [settings.velocity_noise_std, settings.angular_velocity_noise_std]
    walk = [settings.velocity_walk_std, settings.angular_velocity_walk_std]
    return np.repeat(noise, 3), np.repeat(walk, 3)


def track_priors(
    settings: RobocentricSettings, observation: StereoObservation
) -> tuple[Array, float]:
    """Variances (3,) of image points, and the standard deviation of a disparity's offset."""
    return observation.image_point_noise.diagonal().copy(), settings.disparity_offset_std


def twist_error(measured: Array, twist: Array, gyro_bias: Array) -> Array:
    """What a measured twist (6,) is off from the estimate, the bias taken into account."""
    error = measured - twist
    error[3:] -= gyro_bias
    return error


def learn_motion(
    noise: MotionNoise,
    before: tuple[Array, Array],
    twist: Array,
    P: Array,
    error: Array,
    tau: float,
) -> None:
    """Learn the noise of the motion from a step that vision has seen.

    Parameters
    ----------
    noise : MotionNoise
    before : tuple of ndarray, (6,)
        The twist and its variances before the step's measurements.
    twist : ndarray, (6,)
        After them, metres and radians a second.
    P : ndarray, (16, 16)
        Covariance of the vehicle state after them.
    error : ndarray, (6,)
        Of the measured twist, see :func:`twist_error`.
    tau : float
        Seconds of the step.
    """
    H = TWIST_ROWS
    twist_before, variances_before = before
    spread = np.sum((H @ P) * H, axis=1)
    change, variances = twist - twist_before, P.diagonal()[TWIST]
    noise.update(change, variances_before, variances, error, spread, tau)


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
