# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint EKF in disparity space, with the body's twist and the gyroscope's bias in its state.

A landmark is its image point ``y = (u_left, u_right, v)`` in the current left camera. Its first
observation is itself the landmark's estimate, its noise the landmark's covariance, and it depends
on nothing else: initialising is exact. Observing is linear, ``H = [0 I]``. The one nonlinearity
is the warp over a step (see warp), which is mild at every depth and for every disparity, zero and
negative ones included.

One step from stamp k - 1 to k, of tau seconds:

1. The twist u takes a random step (white acceleration noise); it now stands for the constant twist
   of this step.
2. The prediction's mean twist over this step measures it: ``z = [v; omega + b_g] + n``.
3. The body moves, ``T <- T Exp(tau u)``, and every landmark is warped by the same motion. No noise
   enters here: all of it is in u, whose correlation with pose and landmarks is kept.
4. The frame's image points correct everything.
"""

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core import se3
from vislam_ros.core.camera import StereoCamera
from vislam_ros.core.error_operations import (
    Admission,
    Correction,
    PoseMark,
    Retirement,
    Transition,
)
from vislam_ros.core.estimator import Outcome
from vislam_ros.core.gating import passes_gates
from vislam_ros.core.landmarks import LandmarkStore
from vislam_ros.core.lens import corrected
from vislam_ros.core.linear_update import correct
from vislam_ros.core.motion import Increment, symmetrized
from vislam_ros.core.observation import StereoObservation
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.tape import Tape
from vislam_ros.core.tracks import Keys, TrackedFrame, slots_of
from vislam_ros.core.twist_noise import TwistNoise
from vislam_ros.core.warp import warp

Array = NDArray[np.float64]

# The small part of the error state: pose [rho; theta], twist [v; omega], gyroscope bias, lens.
_POSE, _TWIST, _BIAS, _LENS = slice(0, 6), slice(6, 12), slice(12, 15), 15
_SMALL = 16

# Before the first motion nothing is known of the twist but that it is a vehicle's.
_FIRST_TWIST_STD = np.array([50.0, 50.0, 50.0, 2.0, 2.0, 2.0])

# Nothing moves in less than this, and no twist can be told from it [s].
_SHORTEST_STEP = 1e-4

# A landmark has a position in metres where its disparity is positive beyond doubt; nearer to zero
# than this many standard deviations no Gaussian in metres describes it.
_SIGNIFICANT_DISPARITY = 2.0


class RobocentricFilter:
    """EKF over ``[xi; delta u; delta b_g; delta kappa; delta y_1; ...; delta y_n]``.

    Parameters
    ----------
    settings : SlamSettings
    camera : StereoCamera
    tape : Tape, optional
        Where to record for the backward pass.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    twist : ndarray, (6,)
        ``[v; omega]`` of the body over the last step, metres and radians a second.
    gyro_bias : ndarray, (3,)
        Radians a second.
    kappa : float
        What rectification has left of the lens's radial distortion (see lens).
    covariance : ndarray, (16 + 3 n, 16 + 3 n)
    keys : ndarray of int64, (n,)
        The active landmarks.
    image_points : ndarray, (n, 3)
        Theirs, in the current left camera, pixels.
    """

    SMALL_SIZE = _SMALL

    def __init__(self, settings: SlamSettings, camera: StereoCamera, tape: Tape | None = None):
        self._settings = settings
        self._camera = camera
        self._tape = tape
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._twist_noise = TwistNoise(
            np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3)
        )
        self._acceleration = np.diag(
            np.repeat([settings.velocity_walk_std**2, settings.angular_velocity_walk_std**2], 3)
        )
        self._retired = LandmarkStore()
        self.T_world_body = np.eye(4)
        self.twist = np.zeros(6)
        self.gyro_bias = np.zeros(3)
        self.kappa = 0.0
        self.covariance = np.zeros((_SMALL, _SMALL))
        self.covariance[_POSE, _POSE] = settings.prior_pose_variance * np.eye(6)
        self.covariance[_TWIST, _TWIST] = np.diag(_FIRST_TWIST_STD**2)
        self.covariance[_BIAS, _BIAS] = settings.gyro_bias_std**2 * np.eye(3)
        self.covariance[_LENS, _LENS] = settings.lens_distortion_std**2
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.image_points: Array = np.empty((0, 3))

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self.covariance[_POSE, _POSE].copy()

    @property
    def gyro_bias_std(self) -> Array:
        """Standard deviations (3,) of the gyroscope bias, radians a second."""
        return np.sqrt(np.maximum(np.diag(self.covariance[_BIAS, _BIAS]), 0.0))

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block."""
        return len(self.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks with a position, those set aside and those tracked."""
        return self._retired.count + int(self._has_position().sum())

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Retire, move, correct and admit."""
        if self._tape is not None:
            self._tape.begin_step(self.covariance)
        self._retire(np.isin(self.keys, frame.ended))
        passed = np.empty(0, dtype=np.int64)
        if increment.duration > _SHORTEST_STEP:
            self._measure_twist(increment)
            passed = self._move(increment.duration)
        known = np.isin(frame.keys, self.keys)
        outcome = self._correct(frame.keys[known], frame.pixels[known])
        self._retire(np.isin(self.keys, outcome.rejected))
        # What the body has passed cannot be what is seen: its track begins anew at the next frame.
        new = ~known & ~np.isin(frame.keys, passed)
        self._admit(frame.keys[new], frame.pixels[new], frame.copied[new])
        if self._tape is not None:
            self._tape.record(PoseMark(self.T_world_body))
        rejected = np.concatenate([outcome.rejected, np.intersect1d(passed, frame.keys)])
        return Outcome(outcome.used, int(np.sum(new)), rejected, outcome.nis, outcome.nis_dof)

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._retired.all()
        tracked = self._has_position()
        positions, P_mm, _, _ = self._positions(tracked)
        return (
            np.concatenate([keys, self.keys[tracked]]),
            np.concatenate([means, positions]),
            np.concatenate([covariances, P_mm]),
        )

    def _measure_twist(self, increment: Increment) -> None:
        """Let the twist take its random step, then correct it by the prediction's."""
        tau = increment.duration
        measured = se3.log(increment.T) / tau
        self._twist_noise.add(measured)
        noise = np.zeros((_SMALL, _SMALL))
        noise[_TWIST, _TWIST] = tau * self._acceleration
        noise[_BIAS, _BIAS] = self._settings.gyro_bias_walk_std**2 * tau * np.eye(3)
        P = self.covariance
        P[:_SMALL, :_SMALL] += noise
        H = np.zeros((6, _SMALL))
        H[:, _TWIST] = np.eye(6)
        H[3:, _BIAS] = np.eye(3)
        R = np.diag(self._twist_noise.std**2)
        residual = measured - self.twist
        residual[3:] -= self.gyro_bias
        HP = H @ P[:_SMALL]
        S = HP[:, :_SMALL] @ H.T + R
        self._apply(S, HP, residual)
        if self._tape is not None:
            self._tape.record(Transition(np.eye(_SMALL), noise))
            self._tape.record(Correction(residual[None], R, H_small=H[None]))

    def _move(self, tau: float) -> Keys:
        """Move the body and warp every landmark; return the keys of those it has passed."""
        motion = se3.exp(tau * self.twist)
        by_twist = tau * se3.right_jacobian(tau * self.twist)
        warped = warp(self._camera, self.image_points, motion, self.kappa)
        passed = self.keys[~warped.ahead]
        if len(passed):
            self._retire(~warped.ahead)
            warped = warp(self._camera, self.image_points, motion, self.kappa)
        small = np.eye(_SMALL)
        small[_POSE, _POSE] = se3.adjoint(se3.inverse(motion))
        small[_POSE, _TWIST] = by_twist
        coupling = np.zeros((self.active, 3, _SMALL))
        coupling[:, :, _TWIST] = warped.G @ by_twist
        coupling[:, :, _LENS] = warped.by_kappa
        transition = Transition(small, np.zeros((_SMALL, _SMALL)), warped.F_y, coupling)
        self.covariance, _ = transition.carry(self.covariance, _SMALL)
        self.T_world_body = self.T_world_body @ motion
        self.image_points = warped.y
        if self._tape is not None:
            self._tape.record(transition)
        return passed

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        """Correct by the observations of active landmarks that pass the gates."""
        if len(keys) < self._settings.min_observations:
            return Outcome()
        slots = slots_of(keys, self.keys)
        observed = self._observation.image_points(pixels)
        residual = observed - self.image_points[slots]
        P, noise = self.covariance, self._observation.image_point_noise
        rows = _SMALL + 3 * slots[:, None] + np.arange(3)
        blocks = P[rows[:, :, None], rows[:, None, :]] + noise
        passed = passes_gates(self._settings, residual, blocks)
        if not np.any(passed):
            return Outcome(rejected=keys)
        used = rows[passed].ravel()
        HP = P[used]
        S = HP[:, used]
        n = len(used) // 3
        S.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] += noise
        try:
            nis = self._apply(S, HP, residual[passed].ravel())
        except scipy.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            return Outcome(rejected=keys)
        if self._tape is not None:
            identity = np.broadcast_to(np.eye(3), (n, 3, 3))
            self._tape.record(
                Correction(residual[passed], noise, H_landmark=identity, slots=slots[passed])
            )
        return Outcome(n, rejected=keys[~passed], nis=nis, nis_dof=3 * n)

    def _apply(self, S: Array, HP: Array, residual: Array) -> float:
        """Correct the state by a residual (m,) with S (m, m) and H P (m, D); return the NIS."""
        delta, nis = correct(self.covariance, S, HP, residual)
        self.T_world_body = self.T_world_body @ se3.exp(delta[_POSE])
        self.twist = self.twist + delta[_TWIST]
        self.gyro_bias = self.gyro_bias + delta[_BIAS]
        self.kappa += float(delta[_LENS])
        self.image_points = self.image_points + delta[_SMALL:].reshape(-1, 3)
        return nis

    def _admit(self, keys: Keys, pixels: Array, copied: NDArray[np.bool_]) -> None:
        """Begin landmarks at their first observation."""
        if not len(keys):
            return
        y = self._observation.image_points(pixels)
        noise = np.tile(self._observation.image_point_noise, (len(keys), 1, 1))
        # A track begun at a copied pixel has the disparity of the point it stood for before.
        stale = self._settings.stale_disparity * np.abs(y[:, 0] - y[:, 1])
        noise[copied, 1, 1] += stale[copied] ** 2
        admission = Admission(noise)
        self.covariance, _ = admission.carry(self.covariance, _SMALL)
        if self._tape is not None:
            self._tape.record(admission)
        self.keys = np.concatenate([self.keys, keys])
        self.image_points = np.concatenate([self.image_points, y])

    def _retire(self, gone: NDArray[np.bool_]) -> None:
        """Set landmarks aside; those with a position enter the map."""
        if not np.any(gone):
            return
        mapped = gone & self._has_position()
        positions, P_mm, J_small, J_landmark = self._positions(mapped)
        self._retired.add(self.keys[mapped], positions, P_mm)
        if self._tape is not None:
            # What has no position leaves the error state all the same, as zeros.
            among = mapped[gone]
            retirement = Retirement(
                self.keys[gone],
                _scattered(positions, among),
                gone,
                _scattered(J_small, among),
                _scattered(J_landmark, among),
            )
            self._tape.record(retirement)
        self.keys, self.image_points = self.keys[~gone], self.image_points[~gone]
        kept = np.concatenate([np.ones(_SMALL, dtype=bool), np.repeat(~gone, 3)])
        self.covariance = self.covariance[np.ix_(kept, kept)]

    def _disparity_std(self) -> Array:
        """Standard deviations (n,) of the disparities, pixels."""
        left = _SMALL + 3 * np.arange(self.active)
        P = self.covariance
        variance = P[left, left] + P[left + 1, left + 1] - 2 * P[left, left + 1]
        return np.sqrt(np.maximum(variance, 0.0))

    def _has_position(self) -> NDArray[np.bool_]:
        y, _, _ = corrected(self._camera, self.image_points, self.kappa)
        disparity = y[:, 0] - y[:, 1]
        return disparity > _SIGNIFICANT_DISPARITY * self._disparity_std()

    def _positions(self, chosen: NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
        """World positions of active landmarks, with the error they have there.

        Returns
        -------
        positions : ndarray, (m, 3)
            Metres.
        P_mm : ndarray, (m, 3, 3)
        J_small : ndarray, (m, 3, 16)
            Derivative by the small part.
        J_landmark : ndarray, (m, 3, 3)
            Derivative by the image point.
        """
        y, by_y, by_kappa = corrected(self._camera, self.image_points[chosen], self.kappa)
        m = len(y)
        T_body_camera, T = self._camera.T_body_camera, self.T_world_body
        points_body = self._camera.triangulate(y) @ T_body_camera[:3, :3].T + T_body_camera[:3, 3]
        R = T[:3, :3]
        positions = points_body @ R.T + T[:3, 3]
        J_small = np.zeros((m, 3, _SMALL))
        J_small[:, :, :3] = R
        J_small[:, :, 3:6] = -R @ se3.hat(points_body)
        J_straight = (R @ T_body_camera[:3, :3]) @ self._camera.triangulate_jacobian(y)
        J_small[:, :, _LENS] = (J_straight @ by_kappa[..., None])[..., 0]
        J_landmark = J_straight @ by_y
        rows = _SMALL + 3 * np.nonzero(chosen)[0][:, None] + np.arange(3)
        P = self.covariance
        cross = P[rows][:, :, :_SMALL]
        own = P[rows[:, :, None], rows[:, None, :]]
        J_s, J_y = J_small, J_landmark
        mixed = J_y @ cross @ np.swapaxes(J_s, -1, -2)
        P_mm = (
            J_s @ P[:_SMALL, :_SMALL] @ np.swapaxes(J_s, -1, -2)
            + mixed
            + np.swapaxes(mixed, -1, -2)
            + J_y @ own @ np.swapaxes(J_y, -1, -2)
        )
        return positions, symmetrized(P_mm), J_small, J_landmark


def _scattered(values: Array, places: NDArray[np.bool_]) -> Array:
    """Spread rows to the places (n,) that are true, with zeros elsewhere."""
    result = np.zeros((len(places), *values.shape[1:]))
    result[places] = values
    return result
