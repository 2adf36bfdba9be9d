# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion over a step: the pose increment, its noise, and how an error travels along it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import MotionSettings

Array = NDArray[np.float64]

FIRST_TWIST_STD = np.array([50.0, 50.0, 50.0, 2.0, 2.0, 2.0])
"""Before the first motion nothing is known of the twist but that it is a vehicle's."""

UNKNOWN_VELOCITY_VARIANCE = float(FIRST_TWIST_STD[0] ** 2)
"""Of a velocity that nothing measures [m^2/s^2]; one that is told with more is no measurement."""


class Part(NamedTuple):
    """A part of a step, over which the twist counts as constant.

    Attributes
    ----------
    duration : float
        Seconds.
    measured : ndarray, (6,), or None
        The sample of the twist that stands for this part, ``[v; omega]``, or the mean of many;
        None where a sample is missing or still to come. A velocity that is not measured is NaN.
    """

    duration: float
    measured: Array | None


@dataclass(frozen=True)
class Increment:
    """Motion of the body between two stamps, as the prediction sees it.

    Attributes
    ----------
    T : ndarray, (4, 4)
        Pose of the body at the later stamp in the body at the earlier one.
    duration : float
        Seconds.
    covariance : ndarray, (6, 6)
        Covariance W of the error on the right of ``T``, ``[rho; theta]``.
    parts : tuple of Part
        The step, sample by sample of the twist.
    """

    T: Array
    duration: float
    covariance: Array
    parts: tuple[Part, ...] = ()

    @property
    def transition(self) -> Array:
        """Matrix ``F = Ad(T^-1)`` (6, 6) that carries an earlier error over the step."""
        return se3.adjoint(se3.inverse(self.T))

    @property
    def measures_velocity(self) -> bool:
        """Whether the translation was measured, and not the rotation alone."""
        measured = [part.measured for part in self.parts if part.measured is not None]
        return all(measures_velocity(twist) for twist in measured)

    def moved_at(self, velocity: Array) -> Array:
        """Pose ``T`` (4, 4), with a velocity (3,) in the body where none was measured."""
        if self.measures_velocity:
            return self.T
        twist = np.concatenate([velocity, se3.log_rotation(self.T[:3, :3]) / self.duration])
        return se3.exp(self.duration * twist)


class Twist(NamedTuple):
    """Twist of the body in its own axes.

    Attributes
    ----------
    mean : ndarray, (6,)
        ``[v; omega]``, metres and radians a second.
    covariance : ndarray, (6, 6)
    """

    mean: Array
    covariance: Array


def mean_twist(increment: Increment) -> Twist:
    """Twist that moves the body by an increment in its time, with the increment's noise.

    ``Log(T Exp(w)) = Log(T) + J_r^-1 w`` to first order.
    """
    tau = increment.duration
    if not tau:
        return Twist(np.zeros(6), np.diag(FIRST_TWIST_STD**2))
    xi = se3.log(increment.T)
    J = np.linalg.inv(tau * se3.right_jacobian(xi))
    return Twist(xi / tau, J @ increment.covariance @ J.T)


def process_covariance(settings: MotionSettings, duration: float, share: float = 1.0) -> Array:
    """Covariance W (6, 6) of the motion over one sample of the twist.

    White noise sigma on a twist that is held for tau seconds moves the pose by sigma tau.

    Parameters
    ----------
    settings : MotionSettings
    duration : float
        The time tau for which the sample is held, seconds.
    share : float
        The part of that time which is asked for; variances of parts add up to the whole's.
    """
    if settings.process_noise == "constant":
        return share * settings.process_variance * np.eye(6)
    linear = (settings.velocity_noise_std * duration) ** 2
    angular = (settings.angular_velocity_noise_std * duration) ** 2
    return share * np.diag([linear, linear, linear, angular, angular, angular])


def angular_twist(omega: ArrayLike) -> Array:
    """Twist (6,) of which only the angular velocity (3,) is measured; see :class:`Part`."""
    return np.concatenate([np.full(3, np.nan), omega])


def measures_velocity(twist: Array) -> bool:
    """Tell whether a measured twist (6,) has a velocity."""
    return not np.isnan(twist[0])


def propagate(covariance: Array, increment: Increment) -> Array:
    """Covariance of a pose after an increment: ``F Sigma F^T + W`` (the report's eq. 52)."""
    F = increment.transition
    return F @ covariance @ F.T + increment.covariance


def symmetrized(matrix: Array) -> Array:
    """Symmetric part of matrices (..., n, n)."""
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))
