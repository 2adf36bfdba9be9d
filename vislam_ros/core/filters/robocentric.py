# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint EKF in disparity space, with the body's twist and the sensors' biases in its state.

A landmark is its image point ``y = (u_left, u_right, v)`` in the current left camera. Its first
observation is itself the landmark's estimate, its noise the landmark's covariance, and it depends
on nothing else: initialising is exact. Observing is linear, ``H = [0 I]``. The one nonlinearity
is the warp over a step (see warp), which is mild at every depth and for every disparity, zero and
negative ones included.

Image points are kept free of the lens's distortion, observations are freed of it by the present
kappa, and a landmark's error is the one that remains at a given kappa: ``y = y_hat + delta_y +
D(y_hat) delta_kappa`` (see lens). So a wrong kappa shows in the motion of image points only, as
it does in a camera.

One step from stamp k - 1 to k, of tau seconds:

1. The twist u takes a random step (white acceleration noise); it now stands for the constant twist
   of this step.
2. The prediction's mean twist over this step measures it: ``z = [v + b_v; omega + b_g] + n``. The
   velocity's direction is off by a slow error on real vehicles (b_v, sideways and upwards: on
   KITTI-360 by up to 5 degrees), and a vehicle goes where it points but for some slip, the more
   where it turns and the body's origin is not on the axle that follows.
3. The body moves, ``T <- T Exp(tau u)``, and every landmark is warped by the same motion. No noise
   enters here: all of it is in u, whose correlation with pose and landmarks is kept.
4. The frame's image points correct everything.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.columns import Estimate
from vislam_ros.core.compiled import compiled
from vislam_ros.core.filters import quantities
from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.image_point_map import (
    ImagePointMap,
    ImagePoints,
    has_position,
    world_positions,
)
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.geometry.warp import warp
from vislam_ros.core.linalg.gating import Consensus, consensus, passes_gates
from vislam_ros.core.linalg.linear_update import (
    Scratch,
    correct_directly,
    diagonal_blocks,
    innovation_covariance,
    inverse_of_positive,
    whitened,
    without,
)
from vislam_ros.core.motion import FIRST_TWIST_STD, Increment, Twist
from vislam_ros.core.noise.disparity_prior import DisparityPrior
from vislam_ros.core.noise.motion_noise import MotionNoise
from vislam_ros.core.noise.track_noise import TrackNoise
from vislam_ros.core.smoothing.error_operations import (
    Admission,
    Correction,
    DirectCorrection,
    PoseMark,
    RandomWalk,
    Retirement,
    Transition,
    landmark_rows,
    seen_and_rest,
)
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import among, slots_of

Array = NDArray[np.float64]

# The small part of the error state: pose [rho; theta], twist [v; omega], gyroscope bias, velocity
# bias, lens.
_POSE, _TWIST, _BIAS, _VELOCITY_BIAS = slice(0, 6), slice(6, 12), slice(12, 15), slice(15, 17)
_LENS = 17
_SMALL = 18

# What a landmark's position in the world depends on besides its image point: pose and lens.
_PLACING = np.array([0, 1, 2, 3, 4, 5, _LENS])

# The velocity's components, and the twist's, that are zero where a vehicle goes where it points.
_ASIDE, _TWIST_ASIDE = slice(1, 3), slice(7, 9)
# The turn rates that sway a place ahead of the origin sideways and up: yaw and pitch.
_SWAYING = np.array([5, 4])

# Nothing moves in less than this, and no twist can be told from it [s].
_SHORTEST_STEP = 1e-4


class _Twist(NamedTuple):
    """A step's twist (6,) before it is measured, its variances (6,), and the measurement (6,)."""

    mean: Array
    variances: Array
    measured: Array


class RobocentricFilter:
    """EKF over ``[xi; delta u; delta b_g; delta b_v; delta kappa; delta y_1; ...; delta y_n]``.

    Parameters
    ----------
    settings : RobocentricSettings
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
    velocity_bias : ndarray, (2,)
        Of the measured velocity's y and z, metres a second.
    covariance : ndarray, (18 + 3 n, 18 + 3 n)
    keys : ndarray of int64, (n,)
        The active landmarks.
    image_points : ndarray, (n, 3)
        Theirs, in the current left camera, pixels, free of distortion.
    """

    SMALL_SIZE = _SMALL

    def __init__(
        self, settings: RobocentricSettings, camera: StereoCamera, tape: Tape | None = None
    ):
        self._settings = settings
        self._camera = camera
        self._tape = tape
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._motion_noise = MotionNoise(
            np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3),
            np.repeat([settings.velocity_walk_std, settings.angular_velocity_walk_std], 3),
        )
        self._track_noise = TrackNoise(
            np.diag(self._observation.image_point_noise).copy(),
            settings.disparity_offset_std,
            learns=settings.learn_noise,
        )
        self._disparity_prior = DisparityPrior() if settings.disparity_prior else None
        self._H_twist = _twist_rows(settings.slip_std > 0)
        self._scratch = Scratch()
        self._set_aside = ImagePointMap(camera)
        self.T_world_body = np.eye(4)
        self.twist = np.zeros(6)
        self.gyro_bias = np.zeros(3)
        self.velocity_bias = np.zeros(2)
        self.kappa = 0.0
        self.covariance = np.zeros((_SMALL, _SMALL))
        self.covariance[_POSE, _POSE] = settings.prior_pose_variance * np.eye(6)
        self.covariance[_TWIST, _TWIST] = np.diag(FIRST_TWIST_STD**2)
        self.covariance[_BIAS, _BIAS] = settings.gyro_bias_std**2 * np.eye(3)
        velocity_bias_variance = settings.velocity_bias_std**2 * np.eye(2)
        self.covariance[_VELOCITY_BIAS, _VELOCITY_BIAS] = velocity_bias_variance
        self.covariance[_LENS, _LENS] = settings.lens_distortion_std**2
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.image_points: Array = np.empty((0, 3))

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self.covariance[_POSE, _POSE].copy()

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block."""
        return len(self.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks with a position, those set aside and those tracked."""
        return self._set_aside.count + int(np.count_nonzero(self._has_position()))

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Retire, move, correct and admit."""
        if self._tape is not None:
            self._tape.begin_step(self.covariance)
        if len(frame.ended):
            self._retire(among(self.keys, frame.ended))
        passed = np.empty(0, dtype=np.int64)
        moved = increment.duration > _SHORTEST_STEP
        if moved:
            before, Y = self._measure_twist(increment)
            passed = self._move(increment.duration, Y)
        slots = slots_of(frame.keys, self.keys)
        known = slots >= 0
        outcome = self._correct(frame.keys[known], slots[known], frame.pixels[known])
        if self._settings.learn_noise and moved and outcome.used:
            self._learn_motion_noise(increment.duration, before)
        # What the body has passed cannot be what is seen: its track begins anew at the next frame.
        new = ~known
        if len(passed):
            new &= ~among(frame.keys, passed)
        self._admit(frame.keys[new], frame.pixels[new], frame.copied[new])
        if self._tape is not None:
            self._tape.record(PoseMark(self.T_world_body))
        rejected = outcome.rejected
        if len(passed):
            rejected = np.concatenate([rejected, passed[among(passed, frame.keys)]])
        return replace(
            outcome,
            admitted=int(np.count_nonzero(new)),
            rejected=rejected,
            twist=Twist(self.twist, self.covariance[_TWIST, _TWIST].copy()),
            estimates=self._estimates(),
        )

    def _estimates(self) -> tuple[Estimate, ...]:
        """What else is in the vehicle's state, and the noise as it is learned."""
        std = np.sqrt(np.maximum(self.covariance.diagonal()[:_SMALL], 0.0))
        pixel_variance = self._track_noise.level * sum(self._settings.pixel_variance) / 4
        twist_noise_std = np.sqrt(self._motion_noise.twist_variance)
        walk_std = np.sqrt(self._motion_noise.walk_variance)
        return (
            Estimate(quantities.GYRO_BIAS, self.gyro_bias, std[_BIAS]),
            Estimate(quantities.VELOCITY_BIAS, self.velocity_bias, std[_VELOCITY_BIAS]),
            Estimate(quantities.LENS_DISTORTION, self.kappa, std[_LENS]),
            Estimate(quantities.PIXEL_NOISE_STD, pixel_variance**0.5),
            Estimate(quantities.VELOCITY_NOISE_STD, twist_noise_std[0]),
            Estimate(quantities.ANGULAR_VELOCITY_NOISE_STD, twist_noise_std[3]),
            Estimate(quantities.VELOCITY_WALK_STD, walk_std[:3]),
            Estimate(quantities.ANGULAR_VELOCITY_WALK_STD, walk_std[3:]),
        )

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._set_aside.all()
        tracked = np.flatnonzero(self._has_position())
        positions = world_positions(self._camera, self._image_points_of(tracked))
        return (
            np.concatenate([keys, self.keys[tracked]]),
            np.concatenate([means, positions.means]),
            np.concatenate([covariances, positions.covariances]),
        )

    def _measure_twist(self, increment: Increment) -> tuple[_Twist, Array]:
        """Let the twist take its random step, then correct the estimate by the prediction's.

        Returns
        -------
        before : _Twist
            The twist when it had taken its step.
        Y : ndarray, (r, D)
            The covariance, which is left to the motion, is ``P - Y^T Y``.
        """
        tau, settings = increment.duration, self._settings
        measured = se3.log(increment.T) / tau
        self._motion_noise.hear(measured)
        walk = np.zeros(_SMALL)
        walk[_TWIST] = tau * self._motion_noise.walk_variance
        walk[_BIAS] = tau * settings.gyro_bias_walk_std**2
        walk[_VELOCITY_BIAS] = tau * settings.velocity_bias_walk_std**2
        P = self.covariance
        variances = P.reshape(-1)[:: len(P) + 1]
        variances[:_SMALL] += walk
        before = _Twist(self.twist, variances[_TWIST].copy(), measured)
        H = self._H_twist
        R, residual = np.empty(len(H)), np.empty(len(H))
        R[:6], R[6:] = self._motion_noise.twist_variance, settings.slip_std**2 / tau
        R[6:] += np.square(settings.axle_distance * self.twist[_SWAYING])[: len(H) - 6]
        residual[:6] = self._twist_error(measured)
        residual[6:] = -self.twist[_ASIDE][: len(H) - 6]
        Y, whitened_residual = whitened(P, H, R, residual)
        self._shift(whitened_residual @ Y)
        if self._tape is not None:
            self._tape.record(RandomWalk(np.diag(walk)))
            self._tape.record(Correction(residual[None], np.diag(R), H_small=H[None]))
        return before, Y

    def _twist_error(self, measured: Array) -> Array:
        """What a measured twist (6,) is off from the estimate, biases taken into account."""
        error = measured - self.twist
        error[_ASIDE] -= self.velocity_bias
        error[3:] -= self.gyro_bias
        return error

    def _learn_motion_noise(self, tau: float, before: _Twist) -> None:
        """Tell the noise of the motion what a step that vision has seen says of it."""
        P, H = self.covariance[:_SMALL, :_SMALL], self._H_twist[:6]
        change, variances = self.twist - before.mean, P.diagonal()[_TWIST]
        unexplained = self._twist_error(before.measured) ** 2 + np.sum((H @ P) * H, axis=1)
        self._motion_noise.learn(change, before.variances, variances, unexplained, tau)

    def _move(self, tau: float, Y: Array) -> Keys:
        """Move the body and warp every landmark; return the keys of those it has passed.

        Parameters
        ----------
        tau : float
            Seconds.
        Y : ndarray, (r, D)
            By whose square the covariance is still too large.
        """
        motion = se3.exp(tau * self.twist)
        by_twist = tau * se3.right_jacobian(tau * self.twist)
        warped = warp(self._camera, self.image_points, motion)
        passed = self.keys[~warped.ahead]
        still_due: Array | None = Y
        if len(passed):
            self.covariance -= Y.T @ Y
            still_due = None
            self._retire(~warped.ahead)
            warped = warp(self._camera, self.image_points, motion)
        small = np.eye(_SMALL)
        small[_POSE, _POSE] = se3.adjoint(se3.inverse(motion))
        small[_POSE, _TWIST] = by_twist
        shift = radial_shift(self._camera, self.image_points)
        shift_new = radial_shift(self._camera, warped.y)
        coupling = _coupling(warped.G, by_twist, warped.F_y, shift, shift_new)
        transition = Transition(small, warped.F_y, coupling)
        self.covariance, _ = transition.carry(self.covariance, _SMALL, self._scratch, still_due)
        self.T_world_body = self.T_world_body @ motion
        self.image_points = warped.y
        if self._tape is not None:
            self._tape.record(transition)
        return passed

    def _correct(self, keys: Keys, slots: NDArray[np.int64], pixels: Array) -> Outcome:
        """Correct by the observations of active landmarks that are believed; retire the others."""
        if len(keys) < self._settings.min_observations:
            return Outcome()
        residual = self._straight(pixels) - self.image_points[slots]
        noise = self._track_noise.variances(slots)
        try:
            believed = self._believed(slots, residual, noise)
        except scipy.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            self._retire(among(self.keys, keys))
            return Outcome(rejected=keys)
        kept, n = believed.kept, len(believed.kept)
        rejected = keys[:0]
        if n < len(keys):
            rejected = np.delete(keys, kept)
            self._retire(among(self.keys, rejected))
            slots = slots_of(keys[kept], self.keys)
        if not n:
            return Outcome(rejected=rejected)
        numbers = len(believed.weighted)
        nis = self._apply_directly(slots, residual[kept], noise[kept], believed)
        return Outcome(n, rejected=rejected, nis=nis, nis_dof=numbers)

    def _believed(self, slots: NDArray[np.int64], residual: Array, noise: Array) -> Consensus:
        """Innovations (n, 3) that pass their own gates and agree with all others."""
        tracks, components = self._track_noise, self._track_noise.components
        gate = tracks.gate(self._settings.chi2_gate)
        own = diagonal_blocks(self.covariance[_SMALL:, _SMALL:], 3)[slots]
        np.einsum("nii->ni", own)[:] += tracks.expected(noise, self.image_points[slots])
        credible = passes_gates(residual, own, gate, self._settings.pixel_gate)
        passed = np.flatnonzero(credible)
        seen, _ = seen_and_rest(slots[passed], components, self.active, _SMALL)
        S = self._scratch.matrix("work", len(seen), len(seen))
        innovation_covariance(self.covariance, seen, _of(noise, passed, components).ravel(), S)
        new = _of(residual, passed, components)
        agreed = consensus(gate, new, inverse_of_positive(S))
        return Consensus(passed[agreed.kept], agreed.inverse, agreed.weighted)

    def _apply_directly(
        self, slots: NDArray[np.int64], residual: Array, noise: Array, believed: Consensus
    ) -> float:
        """Correct by innovations (n, 3) of landmarks with noise variances (n, 3); return the NIS.

        Only those numbers count that tell anything new, and those of the consensus are of them.
        """
        components = self._track_noise.components
        seen, rest = seen_and_rest(slots, components, self.active, _SMALL)
        new, noise = residual[:, components], noise[:, components]
        r, variances, weighted = new.ravel(), noise.ravel(), believed.weighted
        cross = correct_directly(self.covariance, seen, rest, variances, believed.inverse)
        self._track_noise.see(slots, residual, believed.inverse.diagonal(), weighted)
        delta = np.empty(len(self.covariance))
        delta[seen] = r - variances * weighted
        delta[rest] = cross @ weighted
        self._shift(delta)
        if self._tape is not None:
            self._tape.record(DirectCorrection(new, noise, slots, components))
        return float(r @ weighted)

    def _shift(self, delta: Array) -> None:
        """Move the estimate by an error (D,)."""
        self.T_world_body = self.T_world_body @ se3.exp(delta[_POSE])
        self.twist = self.twist + delta[_TWIST]
        self.gyro_bias = self.gyro_bias + delta[_BIAS]
        self.velocity_bias = self.velocity_bias + delta[_VELOCITY_BIAS]
        self.kappa += float(delta[_LENS])
        change = delta[_SMALL:].reshape(-1, 3)
        change += delta[_LENS] * radial_shift(self._camera, self.image_points)
        self.image_points = self.image_points + change

    def _straight(self, pixels: Array) -> Array:
        """Observed image points (n, 3), freed of distortion."""
        y = self._observation.image_points(pixels)
        return y + self.kappa * radial_shift(self._camera, y)

    def _admit(self, keys: Keys, pixels: Array, copied: NDArray[np.bool_]) -> None:
        """Begin landmarks at their first observation."""
        if not len(keys):
            return
        y = self._straight(pixels)
        self._track_noise.start(self._observation.row_mismatch(pixels))
        noise = self._track_noise.of_new_tracks(y)
        # A track begun at a copied pixel has the disparity of the point it stood for before.
        stale = self._settings.stale_disparity * np.abs(y[:, 0] - y[:, 1])
        noise[copied, 1, 1] += stale[copied] ** 2
        if self._disparity_prior is not None:
            y, noise = self._disparity_prior.applied(y, noise)
        admission = Admission(noise)
        self.covariance, _ = admission.carry(self.covariance, _SMALL, self._scratch)
        if self._tape is not None:
            self._tape.record(admission)
        self._track_noise.begin(len(keys))
        self.keys = np.concatenate([self.keys, keys])
        self.image_points = np.concatenate([self.image_points, y])

    def _retire(self, gone: NDArray[np.bool_]) -> None:
        """Set landmarks (n,) aside; those with a position enter the map."""
        if not gone.any():
            return
        slots = np.flatnonzero(gone)
        points = self._image_points_of(slots)
        mapped = has_position(points.y, points.own)
        self._set_aside.add(self.keys[slots[mapped]], points.of(mapped))
        if self._tape is not None:
            positions = world_positions(self._camera, points.of(mapped))
            J_small = np.zeros((len(slots), 3, _SMALL))
            rows = np.flatnonzero(mapped)[:, None, None]
            J_small[rows, np.arange(3)[:, None], _PLACING] = positions.J_small
            # What has no position leaves the error state all the same, as zeros.
            retirement = Retirement(
                self.keys[slots],
                _scattered(positions.means, mapped),
                gone,
                J_small,
                _scattered(positions.J_landmark, mapped),
            )
            self._tape.record(retirement)
        self._track_noise.end(gone)
        kept = np.concatenate([np.arange(_SMALL), self._rows(np.flatnonzero(~gone)).ravel()])
        self.keys, self.image_points = self.keys[~gone], self.image_points[~gone]
        self.covariance = without(self.covariance, kept, self._scratch)

    def _rows(self, slots: NDArray[np.int64]) -> NDArray[np.int64]:
        """Places (n, 3) of landmarks in the error state."""
        return landmark_rows(slots, _SMALL)

    def _image_points_of(self, slots: NDArray[np.int64]) -> ImagePoints:
        P = self.covariance
        return ImagePoints(
            y=self.image_points[slots],
            own=diagonal_blocks(P[_SMALL:, _SMALL:], 3)[slots],
            cross=P[self._rows(slots)[:, :, None], _PLACING],
            small=P[_PLACING[:, None], _PLACING],
            T_world_body=self.T_world_body,
        )

    def _has_position(self) -> NDArray[np.bool_]:
        own = diagonal_blocks(self.covariance[_SMALL:, _SMALL:], 3)
        return has_position(self.image_points, own)


@compiled(
    "float64[:, :, ::1](float64[:, :, ::1], float64[:, :], float64[:, :, ::1], float64[:, ::1],"
    " float64[:, ::1])"
)
def _coupling(G: Array, by_twist: Array, F_y: Array, shift: Array, shift_new: Array) -> Array:
    """How warped points (n, 3) depend on the small part but the pose: twist, biases and lens."""
    n = len(G)
    coupling = np.zeros((n, 3, _SMALL - 6))
    for i in range(n):
        for r in range(3):
            for c in range(6):
                for k in range(6):
                    coupling[i, r, c] += G[i, r, k] * by_twist[k, c]
            for k in range(3):
                coupling[i, r, -1] += F_y[i, r, k] * shift[i, k]
            coupling[i, r, -1] -= shift_new[i, r]
    return coupling


def _of(numbers: Array, rows: NDArray[np.int64], components: NDArray[np.int64]) -> Array:
    """Some components (r,) of some rows (k,) of numbers (n, 3)."""
    return numbers[rows[:, None], components]


def _twist_rows(straight: bool) -> Array:
    """Derivative (6 or 8, 18) of the measured twist, and of what is no slip, by the small part."""
    H = np.zeros((8, _SMALL))
    H[:6, _TWIST] = np.eye(6)
    H[3:6, _BIAS] = np.eye(3)
    H[_ASIDE, _VELOCITY_BIAS] = np.eye(2)
    H[6:, _TWIST_ASIDE] = np.eye(2)
    return H if straight else H[:6]


def _scattered(values: Array, places: NDArray[np.bool_]) -> Array:
    """Spread rows to the places (n,) that are true, with zeros elsewhere."""
    result = np.zeros((len(places), *values.shape[1:]))
    result[places] = values
    return result


register_estimator(
    "robocentric",
    RobocentricSettings,
    lambda settings, given: RobocentricFilter(settings, given.camera, given.tape),
    vehicle_size=RobocentricFilter.SMALL_SIZE,
    # Its noise of the motion is the walk of the twist in its state.
    unused=("process_noise", "process_variance"),
)
