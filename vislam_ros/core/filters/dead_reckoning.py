# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning: twist samples summed up to a pose.

The report's prediction (eq. 10-13 and 48-52): ``T <- T Exp(tau u)`` and ``P <- F P F^T + W`` with
``F = Ad(Exp(-tau u))``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import Levelling
from vislam_ros.core.motion import (
    UNKNOWN_VELOCITY_VARIANCE,
    Increment,
    angular_twist,
    measures_velocity,
    process_covariance,
    propagate,
    symmetrized,
)
from vislam_ros.core.settings import PredictionSettings, SlamSettings, setting
from vislam_ros.core.tracking.refusals import (
    Refusal,
    RefusalCounts,
    RefusedMessage,
    Stream,
    check_angular_velocity,
    check_twist,
)
from vislam_ros.core.tracking.time_order import Passes
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prediction:
    """A predicted pose.

    Attributes
    ----------
    stamp : int
        Nanoseconds.
    position : ndarray, (3,)
        Body in the odometry frame, metres.
    quaternion : ndarray, (4,)
        x, y, z, w.
    covariance : ndarray, (6, 6)
        Of the error ``[rho; theta]`` on the right of the pose.
    twist : ndarray, (6,)
        ``[v; omega]`` in the body frame, metres and radians a second.
    twist_covariance : ndarray, (6, 6)
    velocity_known : bool
        Whether the velocity was measured; where not, it counts as zero and its covariance says so.
    """

    stamp: int
    position: Array
    quaternion: Array
    covariance: Array
    twist: Array
    twist_covariance: Array
    velocity_known: bool = True

    def __repr__(self) -> str:
        place = ", ".join(f"{value:.2f}" for value in self.position)
        return f"<Prediction at {self.stamp * 1e-9:.3f} s: at ({place}) m>"


class DeadReckoning:
    """Pose from motion alone. It never takes a correction: it is the ``odom`` frame.

    A sample holds over the interval that ends at its stamp, so the first one only starts the
    clock: the pose begins at the identity. From a gyroscope alone the pose turns in its place;
    with an accelerometer beside it, it begins level where the body stands (see
    :mod:`vislam_ros.core.levelling`).
    """

    def __init__(self, settings: PredictionSettings):
        self._settings = settings
        self.refused = RefusalCounts()
        self.resets = 0
        time_jumps = dict.fromkeys((Stream.TWIST, Stream.IMU), settings.time_jump)
        self._passes = Passes(time_jumps, self.refused.add)
        self._pass = 0
        self._start()

    def _start(self) -> None:
        self._stamp: int | None = None
        self._unmeasured = 0.0  # seconds without a velocity
        self._T = np.eye(4)
        self._covariance = self._settings.prior_pose_variance * np.eye(6)
        self._levelling: Levelling | None = Levelling()
        self._held: list[tuple[int, Array]] = []  # until it is known how the body stands

    def add_twist(self, stamp: int, twist: ArrayLike) -> list[Prediction]:
        """Carry the pose to a stamp, or to those that are believed with it.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        twist : array_like, (6,)
            ``[v; omega]`` over the interval that ends at ``stamp``.

        Returns
        -------
        list of Prediction
            Empty where the twist is refused, which ``refused`` counts, or held until the next one
            confirms its stamp, as the first is; see :mod:`vislam_ros.core.tracking.time_order`.
        """
        twist = np.asarray(twist, dtype=float)
        try:
            check_twist(twist)
        except RefusedMessage as error:
            self.refused.add(Stream.TWIST, error.refusal, stamp)
            return []
        return self._enter(Stream.TWIST, stamp, (twist, None))

    def add_angular_velocity(
        self, stamp: int, omega: ArrayLike, acceleration: ArrayLike | None = None
    ) -> list[Prediction]:
        """Turn the pose up to a stamp by a gyroscope, as long as there are no twists.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        omega : array_like, (3,)
            Radians a second, over the interval that ends at ``stamp``.
        acceleration : array_like, (3,), optional
            Specific force, m/s^2, where it was measured; one with NaN was not.

        Returns
        -------
        list of Prediction
            As of :meth:`add_twist`; also empty until it is known how the body stands.
        """
        omega = np.asarray(omega, dtype=float)
        try:
            check_angular_velocity(omega)
        except RefusedMessage as error:
            self.refused.add(Stream.IMU, error.refusal, stamp)
            return []
        force = None if acceleration is None else np.asarray(acceleration, dtype=float)
        if force is not None and np.isnan(force).any():
            force = None
        return self._enter(Stream.IMU, stamp, (angular_twist(omega), force))

    def add_motion(
        self, stamp: int, twist: Array, acceleration: Array | None = None
    ) -> list[Prediction]:
        """Take a twist (6,), or what an IMU measured in one whose velocity is NaN."""
        if measures_velocity(twist):
            return self.add_twist(stamp, twist)
        return self.add_angular_velocity(stamp, twist[3:], acceleration)

    def _enter(
        self, stream: Stream, stamp: int, sample: tuple[Array, Array | None]
    ) -> list[Prediction]:
        predictions = []
        for number, believed, (twist, acceleration) in self._passes.enter(stream, stamp, sample):
            if number != self._pass:
                predictions += self._released()
                self._pass = number
                self._start()
                self.resets += 1
            latest = self._held[-1][0] if self._held else self._stamp
            if latest is not None and believed <= latest:  # by the other stream
                self.refused.add(stream, Refusal.LATE, believed)
                continue
            self._held.append((believed, twist))
            if self._levelling is None or self._levelling.add(believed, twist[3:], acceleration):
                predictions += self._released()
        return predictions

    def _released(self) -> list[Prediction]:
        """Predict all that was held, from the attitude in which the body stands."""
        if self._levelling is not None and self._levelling.R_world_body is not None:
            self._T[:3, :3] = self._levelling.R_world_body
        held, self._held, self._levelling = self._held, [], None
        return [self._predict(*sample) for sample in held]

    @property
    def has_twists(self) -> bool:
        """Whether a twist was believed, so that no gyroscope is needed beside them."""
        return self._passes.has_begun(Stream.TWIST)

    @property
    def refused_if_over(self) -> RefusalCounts:
        """What will be refused besides if nothing more comes."""
        return self._passes.refused_if_over()

    def _predict(self, stamp: int, twist: Array) -> Prediction:
        duration = 0.0 if self._stamp is None else (stamp - self._stamp) * 1e-9
        velocity_known = measures_velocity(twist)
        twist_covariance = self._twist_covariance(duration)
        W = process_covariance(self._settings, duration)
        if not velocity_known:
            twist = np.concatenate([np.zeros(3), twist[3:]])
            before, self._unmeasured = self._unmeasured, self._unmeasured + duration
            # What is not known of the velocity does not average out, as noise does.
            spread = self._unmeasured**2 - before**2
            W[:3, :3] = UNKNOWN_VELOCITY_VARIANCE * spread * np.eye(3)
            twist_covariance[:3, :3] = UNKNOWN_VELOCITY_VARIANCE * np.eye(3)
        if self._stamp is not None:
            step = Increment(se3.exp(duration * twist), duration, W)
            self._T = self._T @ step.T
            self._covariance = symmetrized(propagate(self._covariance, step))
        self._stamp = stamp
        return Prediction(
            stamp=stamp,
            position=self._T[:3, 3].copy(),
            quaternion=se3.quaternion_from_rotation(self._T[:3, :3]),
            covariance=self._covariance,
            twist=twist,
            twist_covariance=twist_covariance,
            velocity_known=velocity_known,
        )

    def _twist_covariance(self, duration: float) -> Array:
        """Noise of a twist sample, from the noise it gives the pose over a step."""
        if self._settings.process_noise == "white_twist":
            return process_covariance(self._settings, 1.0)
        if duration == 0.0:
            return np.zeros((6, 6))
        return process_covariance(self._settings, duration) / duration**2


@dataclass(frozen=True)
class DeadReckoningSettings(SlamSettings):
    """Settings of the prediction as an estimator."""

    estimator: str = setting("dead_reckoning", "Which filter runs")


class DeadReckoningEstimator:
    """Prediction only (the report's eq. 51-52): what SLAM is to be compared with."""

    active = 0
    landmark_count = 0

    def __init__(self, settings: DeadReckoningSettings):
        self.T_world_body = np.eye(4)
        self.pose_covariance: Array = settings.prior_pose_variance * np.eye(6)

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Carry the pose over the motion; the frame is not looked at."""
        self.T_world_body = self.T_world_body @ increment.T
        self.pose_covariance = symmetrized(propagate(self.pose_covariance, increment))
        return Outcome()

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Return an empty map."""
        return np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3, 3))


register_estimator(
    "dead_reckoning",
    DeadReckoningSettings,
    lambda settings, given: DeadReckoningEstimator(settings),
    unused=("retire_after", "rest_after_rejection"),
)
