# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The models of the robocentric filter: vehicle state, random walk, measured twist and motion.

The state, its random walk and what is observed are ::

    state  T, u, b, kappa, w, y_1 ... y_n: pose, twist, gyroscope's bias, lens, drift of vision,
           landmarks; T = T_hat Exp(xi), all other errors are differences
    Q      blkdiag(0, tau W_u, tau W_b, 0, W_w), what u and b change by, and a new w
    F      [ Ad(Exp(-tau u'))  tau J_r'     0  0               -tau J_r' B  0        ]  xi
           [ 0                 I            0  0               0            0        ]  delta_u
           [ 0                 0            I  0               0            0        ]  delta_b
           [ 0                 0            0  1               0            0        ]  delta_kappa
           [ 0                 0            0  0               I            0        ]  delta_w
           [ 0                 tau G_i J_r  0  F_i D_i - D_i+  0            blkd F_i ]  delta_y_i
    h, H   of the twist: u' + B b, [0 I B 0 -B 0]; of the image: y, [0 I]

with ``B = [0; I]`` and ``u' = u - B w``.

*Twist.* Image points move by u, the body by u', and the prediction's mean twist over a step is
``z = u' + B b + n``.

*Drift of vision.* Errors that stay, those of lens and rig, turn the motion that images tell by a
little: a walk of the angle with the way, with a w of its own for each step of ``|v| tau`` metres,
``W_w = q |v| / tau``. Where kappa observations tell as much as an independent one (see
track_noise), q is ``kappa - 1`` parts of what it is for two: none where errors are white.

*Motion.* With ``T <- T Exp(tau u')`` and ``y <- w(y, Exp(tau u))`` the errors go over by ::

    pose      Ad(Exp(-tau u')) xi + tau J_r' (delta_u - B delta_w)
    landmark  F_y delta_y + tau G J_r delta_u + (F_y D(y) - D(y+)) delta_kappa

where J_r and J_r' are the right Jacobians at ``tau u`` and ``tau u'``, F_y and G are those of the
warp, and D is the shift of the lens, which a landmark's error is kept apart from (see lens). The
pose's part is the report's eq. 13 and 52, with the twist in the state.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.columns import Estimate
from vislam_ros.core.compiled import compiled
from vislam_ros.core.filters import quantities
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.geometry.warp import Warp, warp
from vislam_ros.core.linalg.gating import mahalanobis_squared
from vislam_ros.core.linalg.linear_update import diagonal_blocks, spread
from vislam_ros.core.motion import FIRST_TWIST_STD, Increment, Part, measures_velocity
from vislam_ros.core.operations.correction import VehicleCorrection
from vislam_ros.core.operations.innovations import Shown
from vislam_ros.core.operations.transition import RandomWalk, Transition

Array = NDArray[np.float64]

# The vehicle state: pose [rho; theta], twist [v; omega], gyroscope bias, lens, drift of vision.
POSE, TWIST, GYRO_BIAS = slice(0, 6), slice(6, 12), slice(12, 15)
LENS = 15
DRIFT = slice(16, 19)
SIZE = 19

# What a landmark's position in the world depends on besides its image point: pose and lens.
POSE_AND_LENS = np.array([0, 1, 2, 3, 4, 5, LENS])

#: Derivative (6, 19) of the body's twist by the vehicle state, and of that which is measured.
BODY_TWIST_ROWS: Array = np.zeros((6, SIZE))
BODY_TWIST_ROWS[:, TWIST] = np.eye(6)
BODY_TWIST_ROWS[3:, DRIFT] = -np.eye(3)
TWIST_ROWS: Array = BODY_TWIST_ROWS.copy()
TWIST_ROWS[3:, GYRO_BIAS] = np.eye(3)

# From how many deviations on a twist shows a change that its walk did not foresee.
_UNFORESEEN = 3.0
# By how much vision turns over a metre where two observations tell as much as one [rad].
_DRIFT = 0.13e-3


@dataclass(frozen=True)
class Vehicle:
    """The estimate of the vehicle's state.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    twist : ndarray, (6,)
        ``[v; omega]`` by which image points moved in the last step, metres and radians a second.
    gyro_bias : ndarray, (3,)
        Radians a second.
    kappa : float
        What rectification has left of the lens's radial distortion (see lens).
    drift : ndarray, (3,)
        By how much images turned faster than the body in the last step, radians a second.
    """

    T_world_body: Array = field(default_factory=lambda: np.eye(4))
    twist: Array = field(default_factory=lambda: np.zeros(6))
    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))
    kappa: float = 0.0
    drift: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def speed(self) -> float:
        """Metres a second."""
        return math.hypot(*self.twist[:3])

    @property
    def body_twist(self) -> Array:
        """``[v; omega]`` (6,) of the body over the last step, metres and radians a second."""
        twist = self.twist.copy()
        twist[3:] -= self.drift
        return twist

    def shifted(self, delta: Array) -> "Vehicle":
        """Return what it is after an error (19,) is taken out."""
        return Vehicle(
            self.T_world_body @ se3.exp(delta[POSE]),
            self.twist + delta[TWIST],
            self.gyro_bias + delta[GYRO_BIAS],
            self.kappa + float(delta[LENS]),
            self.drift + delta[DRIFT],
        )

    def moved(self, motion: Array) -> "Vehicle":
        """Return where it is after a motion (4, 4)."""
        return replace(self, T_world_body=self.T_world_body @ motion)


# Nothing moves in less than this, and no twist can be had from it [s].
_SHORTEST_STEP = 1e-4
# How far a twist may be off that is doubted, in standard deviations.
_DOUBT = 10.0


def motions_of(increment: Increment) -> list[Part]:
    """Parts of an increment in which something moves."""
    return [part for part in increment.parts if part.duration > _SHORTEST_STEP]


def prior_covariance(settings: RobocentricSettings) -> Array:
    """Covariance (19, 19) of the vehicle state before the first frame."""
    variances = np.empty(SIZE)
    variances[POSE] = settings.prior_pose_variance
    variances[TWIST] = FIRST_TWIST_STD**2
    variances[GYRO_BIAS] = settings.gyro_bias_std**2
    variances[LENS] = settings.lens_distortion_std**2
    variances[DRIFT] = 0.0
    return np.diag(variances)


class TwistChange(NamedTuple):
    """What a step's measurements have made of the twist.

    Attributes
    ----------
    delta : ndarray, (6,)
        What they have changed it by.
    before, after : ndarray, (6,)
        Its variances P- and P+.
    """

    delta: Array
    before: Array
    after: Array

    @property
    def unforeseen(self) -> NDArray[np.bool_]:
        """On which axes (6,) it is more than the walk foresees.

        Where the variance of a Gaussian falls from P- to P+, its mean moves by ``N(0, P- - P+)``.
        """
        foreseen = np.maximum(self.before - self.after, 0.0)
        changed: NDArray[np.bool_] = self.delta**2 > _UNFORESEEN**2 * foreseen
        return changed


def doubt_of_twist(covariance: Array, axes: NDArray[np.bool_]) -> RandomWalk:
    """Walk of the vehicle state, of such a covariance (19, 19), where its twist is doubted.

    On such axes (6,) the twist may be off by ten times its standard deviations then, and no more
    than at the start.
    """
    variances = covariance.diagonal()[TWIST]
    doubted = np.minimum(_DOUBT**2 * variances, FIRST_TWIST_STD**2)
    return _walk_of_twist(np.where(axes, np.maximum(doubted - variances, 0.0), 0.0))


def random_walk(
    settings: RobocentricSettings, twist_walk: Array, drifting: float, tau: float
) -> RandomWalk:
    """What the vehicle state changes by at random in tau seconds.

    Parameters
    ----------
    settings : RobocentricSettings
    twist_walk : ndarray, (6,)
        Variances of what the twist changes by in a second.
    drifting : float
        Metres in a second over which vision drifts, by as many as its errors tell in common.
    tau : float
    """
    variances = np.zeros(SIZE)
    variances[TWIST] = tau * twist_walk
    variances[GYRO_BIAS] = tau * settings.gyro_bias_walk_std**2
    variances[DRIFT] = _DRIFT**2 * drifting / tau
    return RandomWalk(np.diag(variances))


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


def twist_error(measured: Array, vehicle: Vehicle) -> Array:
    """What a measured twist (6,) is off from the body's, the bias taken into account."""
    error = measured - vehicle.body_twist
    error[3:] -= vehicle.gyro_bias
    return error


def twist_spread(covariance: Array) -> Array:
    """Variances (6,) of the twist that is to be measured, where the vehicle's is (19, 19)."""
    return spread(TWIST_ROWS, covariance)


def twist_correction(measured: Array, vehicle: Vehicle, variances: Array) -> VehicleCorrection:
    """Correction by a measured twist (6,) of such noise (6,), or by what there is of it."""
    known = slice(0 if measures_velocity(measured) else 3, 6)
    error = twist_error(measured, vehicle)
    return VehicleCorrection(error[known], variances[known], TWIST_ROWS[known])


def unforeseen_walk(measurement: VehicleCorrection, covariance: Array) -> RandomWalk:
    """Walk of the vehicle state, of such a covariance (19, 19), as a measured twist shows it.

    Where no frame with features has come since the last sample, or the frame bears it out, and a
    number is off by more than three of its deviations, the twist has changed by more than its walk
    foresees: the variance of what is measured becomes the square of what it is off.
    """
    beyond = measurement.residual**2 - measurement.expected(covariance)
    more = np.where(unforeseen(measurement, covariance), beyond, 0.0)
    return _walk_of_twist(more @ measurement.H[:, TWIST])


def unforeseen(measurement: VehicleCorrection, covariance: Array) -> NDArray[np.bool_]:
    """Which numbers of a measured twist are off by more than three of their deviations."""
    expected = measurement.expected(covariance)
    off: NDArray[np.bool_] = measurement.residual**2 > _UNFORESEEN**2 * expected
    return off


class Belied(NamedTuple):
    """Which of two twists images contradict, where they bear the other one out.

    Attributes
    ----------
    measured : bool
        The one that is measured: its sensor is wrong.
    foreseen : bool
        The one that is known without it: the body was struck, or turns as it never did.
    """

    measured: bool = False
    foreseen: bool = False


def belied(
    measurement: VehicleCorrection, covariance: Array, shown: Shown, chi2_gate: float
) -> Belied:
    """Judge a measured twist, and the one that is known without it, by what images show.

    Both by their squared distances from that, velocity and angular velocity each for itself: three
    numbers, as of an observation. Most of what is seen must agree, in more numbers than a twist
    has, else nothing is belied.

    Parameters
    ----------
    measurement : VehicleCorrection
    covariance : ndarray, (19, 19)
        Of the vehicle state without it.
    shown : Shown
        By images alone.
    chi2_gate : float
        Bound of the squared distances.
    """
    if not (shown.by_most and shown.numbers > len(TWIST_ROWS)):
        return Belied()
    H, C = measurement.H, shown.covariance
    measured, foreseen = (
        mahalanobis_squared(error.reshape(-1, 3), diagonal_blocks(S, 3)) > chi2_gate
        for error, S in (
            (measurement.residual - H @ shown.delta, H @ C @ H.T + np.diag(measurement.noise)),
            (shown.delta[TWIST], C[TWIST, TWIST] + covariance[TWIST, TWIST]),
        )
    )
    foreseen = foreseen[-len(measured) :]  # a gyroscope alone measures the latter half
    return Belied(bool(np.any(measured & ~foreseen)), bool(np.any(foreseen & ~measured)))


def forgotten_twist(covariance: Array) -> RandomWalk:
    """Walk of the vehicle state, of such a covariance (19, 19), after which no twist is known."""
    return _walk_of_twist(np.maximum(FIRST_TWIST_STD**2 - covariance.diagonal()[TWIST], 0.0))


def _walk_of_twist(variances: Array) -> RandomWalk:
    """Walk by which the twist alone changes, of such variances (6,)."""
    Q = np.zeros((SIZE, SIZE))
    Q[TWIST, TWIST] = np.diag(variances)
    return RandomWalk(Q)


def motion_of(
    camera: StereoCamera, y: Array, vehicle: Vehicle, tau: float
) -> tuple[Vehicle, Warp, Transition]:
    """What a vehicle's twist makes of it and of image points (n, 3) in tau seconds, and F."""
    motion = se3.exp(tau * vehicle.body_twist)
    warped = warp(camera, y, se3.exp(tau * vehicle.twist))
    by_twist = tau * se3.right_jacobian(tau * vehicle.twist)
    by_body_twist = tau * se3.right_jacobian(tau * vehicle.body_twist)
    A = np.eye(SIZE)
    A[POSE, POSE] = se3.adjoint(se3.inverse(motion))
    A[POSE] += by_body_twist @ BODY_TWIST_ROWS
    shift, shift_new = radial_shift(camera, y), radial_shift(camera, warped.y)
    coupling = _coupling(warped.G, by_twist, warped.F_y, shift, shift_new)
    return vehicle.moved(motion), warped, Transition(A, warped.F_y, coupling)


@compiled(
    "float64[:, :, ::1](float64[:, :, ::1], float64[:, :], float64[:, :, ::1], float64[:, ::1],"
    " float64[:, ::1])"
)
def _coupling(G: Array, by_twist: Array, F_y: Array, shift: Array, shift_new: Array) -> Array:
    """How warped points (n, 3) depend on the vehicle state but the pose: on twist and lens."""
    n, lens = len(G), LENS - 6
    coupling = np.zeros((n, 3, SIZE - 6))
    for i in range(n):
        for r in range(3):
            for c in range(6):
                for k in range(6):
                    coupling[i, r, c] += G[i, r, k] * by_twist[k, c]
            for k in range(3):
                coupling[i, r, lens] += F_y[i, r, k] * shift[i, k]
            coupling[i, r, lens] -= shift_new[i, r]
    return coupling


def estimates_of(
    vehicle: Vehicle,
    std: tuple[Array, float],
    pixel_variance: float,
    motion: tuple[Array, Array],
) -> tuple[Estimate, ...]:
    """What else is in the vehicle's state, and the noise as it is learned.

    Parameters
    ----------
    vehicle : Vehicle
    std : tuple
        Of its bias (3,) and its lens.
    pixel_variance : float
        Square pixels.
    motion : tuple of ndarray, (6,)
        Variances of a measured twist, and of what the twist changes by in a second.
    """
    noise, walk = motion
    values: tuple[tuple[ArrayLike, ArrayLike], ...] = (
        (vehicle.gyro_bias, std[0]),
        (vehicle.kappa, std[1]),
        (pixel_variance**0.5, ()),
        (noise[0] ** 0.5, ()),
        (noise[3] ** 0.5, ()),
        (np.sqrt(walk[:3]), ()),
        (np.sqrt(walk[3:]), ()),
    )
    described = zip(quantities.OF_ROBOCENTRIC, values, strict=True)
    return tuple(Estimate(quantity, *value) for quantity, value in described)
