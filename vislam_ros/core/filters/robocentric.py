# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint EKF in disparity space, with the body's twist and the gyroscope's bias in its state.

A landmark is its image point ``y = (u_left, u_right, v)`` in the current left camera. Its first
observation is itself the landmark's estimate, its noise the landmark's covariance, and it depends
on nothing else: initializing is exact. Observing is linear. The one nonlinearity is the warp over
a step, which is mild at every depth and disparity, zero and negative ones included (see warp).

Image points are kept free of the lens's distortion, observations are freed of it by the present
kappa, and a landmark's error is the one that remains at a given kappa: ``y = y_hat + delta_y +
D(y_hat) delta_kappa`` (see lens). So a wrong kappa shows in the motion of image points only, as
it does in a camera. The terms of the EKF (the report's eq. 25-36) are in robocentric_model. A test
holds it to the same in plain numpy, ``test/twins/dense_robocentric.py``, to 1e-9.

A step from stamp k - 1 to k, of tau seconds; where it spans many samples of the twist, 2 to 4 are
taken sample by sample, and where samples are missing, 3 is left out:

1. Landmarks whose track has ended, or that the last frame rejected, are marginalized, and enter
   the map where they have a position.
2. The vehicle state takes a random step, ``P <- P + Q``: above all the twist u (white acceleration
   noise), which now stands for the constant twist of this step, and the drift of vision in it.
   The twist may have changed by more where the last step left it in doubt.
3. The prediction's mean twist measures the body's (without a frame in between: unforeseen_walk).
   Where it is not as foreseen, the present frame tells which of both is wrong (belied).
4. The body moves, and landmarks are warped by the same and the drift, ``P <- F P F^T``: all noise
   is in the vehicle state already. Those that come behind the camera are marginalized before.
   Where nothing has told the velocity, the last frame neither, this is linearized about the twist
   that the present frame shows: an iteration of an iterated EKF (Bell and Cathey, 1993).
5. The frame's image points correct everything, but for those that gates reject, of a frame or of
   all of a track's together. What is far off for its track counts for less.
6. The noise of the motion is learned from what vision has seen of it. Where most of a frame was
   rejected, or the twist has changed by more than its walk foresees, and in the first steps, it is
   left in doubt.
7. Landmarks seen for the first time are initialized.
8. Bias and none are weighed against each other; what is told is their mean (see bias_belief).
"""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters import robocentric_model as model
from vislam_ros.core.filters.estimator import Outcome, Pose
from vislam_ros.core.filters.image_point_map import (
    ImagePointMap,
    ImagePoints,
    has_position,
    image_points_in,
    points_of_both,
    positions_of_all,
    world_positions,
)
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.filters.robocentric_model import DRIFT, GYRO_BIAS, LENS, POSE, SIZE, TWIST
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.linalg import gating
from vislam_ros.core.motion import Increment, Twist, measures_velocity
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.motion_noise import MotionNoise
from vislam_ros.core.noise.track_noise import TrackNoise
from vislam_ros.core.noise.track_runs import TrackRuns
from vislam_ros.core.operations.bias_belief import BiasBelief, bias_belief
from vislam_ros.core.operations.direct_correction import DirectCorrection, correct_gradually
from vislam_ros.core.operations.error_state import ErrorState, Operation, Recorder, Result
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.innovations import Innovations, Shown
from vislam_ros.core.operations.marginalization import Marginalization
from vislam_ros.core.operations.transition import NewBeginning
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import indices_of, is_member

Array = NDArray[np.float64]
Slots = NDArray[np.int64]


class RobocentricFilter:
    """EKF over ``[xi; delta u; delta b; delta kappa; delta w; delta y_1; ...; delta y_n]``.

    What it keeps is given a bias; an outcome, and the map, are the mean of that and of none.

    Parameters
    ----------
    settings : RobocentricSettings
    camera : StereoCamera
    tape : Recorder, optional
        Where to record for the backward pass.

    Attributes
    ----------
    vehicle : Vehicle
        Pose, twist, bias, lens and drift of vision.
    keys : ndarray of int64, (n,)
        The active landmarks.
    image_points : ndarray, (n, 3)
        Theirs, in the current left camera, pixels, free of distortion.
    """

    def __init__(
        self, settings: RobocentricSettings, camera: StereoCamera, tape: Recorder | None = None
    ):
        self._settings = settings
        self._camera = camera
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._frame_rate = FrameRate()
        self._motion_noise = MotionNoise(*model.motion_priors(settings), self._frame_rate)
        self._twist_variance = self._motion_noise.twist_variance
        priors = model.track_priors(settings, self._observation)
        self._track_noise = TrackNoise(*priors, self._frame_rate, learns=settings.learn_noise)
        self._track_runs = TrackRuns()
        self._state = ErrorState(model.prior_covariance(settings), SIZE, tape)
        self._marginalized = ImagePointMap(camera)
        self._believed: BiasBelief | None = None  # of the present state
        # Of the last frame: what of the state it rejected, on which axes it left the twist in
        # doubt, whether there was nothing in it, and whether it has told the twist.
        self._rejected: Keys = np.empty(0, dtype=np.int64)
        self._doubted: NDArray[np.bool_] = np.zeros(6, dtype=bool)
        self._saw_nothing = self._told_twist = False
        self.vehicle = model.Vehicle()
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.image_points: Array = np.empty((0, 3))

    def change_settings(self, settings: RobocentricSettings) -> None:
        """Take other settings; noise that is told anew is learned from there."""
        self._settings = settings
        self._observation = StereoObservation(self._camera, settings.pixel_variance)
        self._motion_noise.tell(*model.motion_priors(settings))
        tracks = model.track_priors(settings, self._observation)
        self._track_noise.tell(*tracks, learns=settings.learn_noise)

    @property
    def covariance(self) -> Array:
        """Covariance (19 + 3 n, 19 + 3 n) of the error state."""
        return self._state.covariance

    @property
    def T_world_body(self) -> Array:
        """Pose (4, 4)."""
        return self.vehicle.T_world_body

    @T_world_body.setter
    def T_world_body(self, T_world_body: Array) -> None:
        self.vehicle = replace(self.vehicle, T_world_body=T_world_body)

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self.covariance[POSE, POSE].copy()

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block that stay."""
        return len(self.keys) - len(self._rejected)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks with a position, those marginalized and those tracked."""
        return self._marginalized.count + int(np.count_nonzero(self._has_position()))

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Take a step, in the order of the text above."""
        self._marginalize(is_member(self.keys, np.concatenate([frame.ended, self._rejected])))
        behind_camera = self._rejected = self.keys[:0]
        if self._doubted.any():
            self._apply(model.doubt_of_twist(self._state.vehicle_covariance, self._doubted))
        parts = model.motions_of(increment)
        if parts:
            self._frame_rate.add(increment.duration)
        for i, (tau, measured) in enumerate(parts):
            twist, variances = self._walk(tau)
            belied = model.Belied() if len(parts) > 1 else self._belied(measured, frame, tau)
            used = None if belied.measured else measured
            may_jump = i > 0 or self._saw_nothing or belied.foreseen
            if used is not None:
                self._measure_twist(used, may_jump=may_jump)
            is_known = self._told_twist or (used is not None and measures_velocity(used))
            shown = None if is_known or i < len(parts) - 1 else self._shown(frame, tau)
            about = None if shown is None else self.vehicle.twist + shown.delta[TWIST]
            behind_camera = np.concatenate([behind_camera, self._move(tau, about)])
        self._saw_nothing = not len(frame.keys)
        seen = slots, factors = self._seen(frame)
        known, y = slots >= 0, self.image_points
        try:
            outcome = self._correct(frame.keys[known], self._innovations(frame, seen, y))
            self._rejected = outcome.rejected
        except np.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            self._marginalize(is_member(self.keys, frame.keys))
            outcome = Outcome(rejected=frame.keys[known])
        self._told_twist = outcome.used > 0
        self._doubted = np.full(6, outcome.is_contradicted)
        if parts and outcome.used:
            P, learns = self._state.vehicle_covariance, self._settings.learn_noise
            before, after = variances, P.diagonal()[TWIST].copy()
            change = model.TwistChange(self.vehicle.twist - twist, before, after)
            if learns and measured is not None:
                error, spread = model.twist_error(measured, self.vehicle), model.twist_spread(P)
                self._motion_noise.update(*change, error, spread, tau, is_used=used is not None)
            self._doubted |= (learns and self._motion_noise.begins) | change.unforeseen
        # What is behind the camera is not what is seen: its track begins anew at the next frame.
        contradicted = is_member(frame.keys, behind_camera)
        new = ~(known | contradicted)
        self._initialize(frame.keys[new], frame.pixels[new], factors[new])
        belief = self._belief()
        last = belief.as_correction(GYRO_BIAS, SIZE) if self._state.is_recorded else None
        self._state.end_step(self.T_world_body, last)
        told, gain = self.vehicle.shifted(belief.delta), belief.gain[:SIZE]
        P = self.covariance[:SIZE, :SIZE] + gain @ belief.spread @ gain.T
        level = self._track_noise.level * self._track_noise.usual_factor
        return replace(
            outcome,
            admitted=int(np.count_nonzero(new)),
            rejected=np.concatenate([outcome.rejected, frame.keys[contradicted]]),
            pose=Pose(told.T_world_body, P[POSE, POSE].copy()),
            twist=Twist(told.body_twist, model.BODY_TWIST_ROWS @ P @ model.BODY_TWIST_ROWS.T),
            estimates=model.estimates_of(
                told,
                (belief.bias_std, max(P[LENS, LENS], 0.0) ** 0.5),
                level * sum(self._settings.pixel_variance) / 4,
                (self._twist_variance, self._motion_noise.walk_variance),
            ),
        )

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._marginalized.all()
        tracked = np.flatnonzero(self._has_position())
        points = self._image_points_of(tracked)
        positions = world_positions(self._camera, self._told(points, tracked))
        return (
            np.concatenate([keys, self.keys[tracked]]),
            np.concatenate([means, positions.means]),
            np.concatenate([covariances, positions.covariances]),
        )

    def _marginalize(self, gone: NDArray[np.bool_]) -> None:
        """Leave landmarks (n,) out of the state; those with a position enter the map."""
        if not gone.any():
            return
        keys, slots = self.keys[gone], np.flatnonzero(gone)
        points = self._image_points_of(slots)
        mapped = has_position(points.y, points.own)
        if mapped.any():
            self._marginalized.add(keys[mapped], self._told(points.of(mapped), slots[mapped]))
        positions = partial(positions_of_all, self._camera, points, mapped)
        self._apply(Marginalization(keys, gone, positions))
        self._track_noise.remove(gone)
        self._track_runs.remove(gone)
        self.keys, self.image_points = self.keys[~gone], self.image_points[~gone]

    def _walk(self, tau: float) -> tuple[Array, Array]:
        """``P <- P + Q``; return the twist (6,) and its variances (6,) as they stand then."""
        drifting = (self._track_noise.observations_per_independent - 1.0) * self.vehicle.speed
        self._apply(NewBeginning(DRIFT))
        walk = self._motion_noise.walk_variance
        self._apply(model.random_walk(self._settings, walk, drifting, tau))
        self.vehicle = replace(self.vehicle, drift=np.zeros(3))
        return self.vehicle.twist, self._state.vehicle_covariance.diagonal()[TWIST].copy()

    def _measure_twist(self, measured: Array, *, may_jump: bool) -> None:
        """Correct by the prediction's mean twist (6,), or what there is of it."""
        self._motion_noise.add(measured)
        self._twist_variance = self._motion_noise.twist_variance
        correction = model.twist_correction(measured, self.vehicle, self._twist_variance)
        if may_jump:
            self._apply(model.unforeseen_walk(correction, self._state.vehicle_covariance))
        self._shift(self._apply(correction).delta)

    def _move(self, tau: float, about: Array | None) -> Keys:
        """Move by the twist, linearized about another (6,) if given; return keys behind camera."""
        believed = self.vehicle.twist
        vehicle = self.vehicle if about is None else replace(self.vehicle, twist=about)
        moved, warped, transition = model.motion_of(self._camera, self.image_points, vehicle, tau)
        if len(behind_camera := self.keys[~warped.ahead]):
            self._marginalize(~warped.ahead)
            _, warped, transition = model.motion_of(self._camera, self.image_points, vehicle, tau)
        self._apply(transition)
        self.vehicle, self.image_points = moved, warped.y
        if about is not None:
            self._shift(transition.moved(TWIST, believed - about))
        return behind_camera

    def _belied(self, measured: Array | None, frame: TrackedFrame, tau: float) -> model.Belied:
        """Judge an unforeseen measured twist (6,) by the frame, tau seconds from now."""
        if measured is None or not (gate := self._settings.chi2_gate):
            return model.Belied()
        P = self._state.vehicle_covariance
        measurement = model.twist_correction(measured, self.vehicle, self._twist_variance)
        if not model.unforeseen(measurement, P).any():
            return model.Belied()
        shown = self._shown(frame, tau, model.forgotten_twist(P))
        return model.belied(measurement, P, shown, gate) if shown else model.Belied()

    def _shown(self, frame: TrackedFrame, tau: float, *before: Operation[None]) -> Shown | None:
        """What a frame, tau seconds from now, shows of the vehicle state; None if nothing."""
        _, warped, transition = model.motion_of(self._camera, self.image_points, self.vehicle, tau)
        innovations = self._innovations(frame, self._seen(frame), warped.y)
        if not (len(innovations.slots) and warped.ahead.all()):
            return None
        return innovations.shown_after(self._state.covariance, SIZE, [*before, transition])

    def _seen(self, frame: TrackedFrame) -> tuple[Slots, Array]:
        """Slots (n,) of a frame's landmarks, -1 for none, and factors (n,) of their noise."""
        factors = self._track_noise.factors(frame.noise, len(frame.keys))
        return indices_of(frame.keys, self.keys), factors

    def _innovations(
        self, frame: TrackedFrame, seen: tuple[Slots, Array], y: Array
    ) -> Innovations:
        """Those of a frame's known landmarks, whose image points (m, 3) are expected at y."""
        slots, factors = seen
        known = slots >= 0
        slots, tracks = slots[known], self._track_noise
        noise = tracks.variances(slots, factors[known])
        residual = self._straight(frame.pixels[known]) - y[slots]
        expected = tracks.expected(noise, y[slots])
        gates = tracks.gate(self._settings.chi2_gate), self._settings.pixel_gate
        return Innovations(slots, residual, noise, expected, tracks.components, *gates)

    def _correct(self, keys: Keys, innovations: Innovations) -> Outcome:
        """Correct by observations of active landmarks, but for outliers."""
        if not len(keys):
            return Outcome()
        inliers = innovations.agreed_over_time_in(self._state, self._track_runs)
        chosen = inliers.indices
        rejected = np.delete(keys, chosen)
        if not len(chosen):
            return Outcome(rejected=rejected)
        slots, residual, noise, _, used, *_ = innovations.of(chosen)
        tails = self._track_noise.with_tails(slots, noise, inliers.inverse, inliers.weighted)
        seen, R, R_tails = residual[:, used], noise[:, used], tails[:, used]
        inliers = gating.with_more_noise(inliers, (R_tails - R).ravel(), seen)
        # A correction in parts works where this inverse lies.
        information = inliers.inverse.diagonal().copy()
        self._believed = None
        correction = DirectCorrection(seen, R_tails, slots, used, inliers)
        self._shift(correct_gradually(self._state, correction))
        self._track_noise.update(slots, residual, noise, information, inliers.weighted)
        nis = float(seen.ravel() @ inliers.weighted)
        return Outcome(len(slots), 0, rejected, nis, len(inliers.weighted))

    def _initialize(self, keys: Keys, pixels: Array, factors: Array) -> None:
        """Add landmarks at their first observation."""
        if not len(keys):
            return
        y, mismatch = self._straight(pixels), self._observation.row_mismatch(pixels)
        self._track_noise.initialize_level(mismatch / np.sqrt(factors))
        self._apply(Initialization(self._track_noise.of_new_tracks(y, factors)))
        self._track_noise.add(len(keys))
        self._track_runs.add(len(keys))
        self.keys = np.concatenate([self.keys, keys])
        self.image_points = np.concatenate([self.image_points, y])

    def _apply(self, operation: Operation[Result]) -> Result:
        """Change the error state."""
        self._believed = None
        return self._state.apply(operation)

    def _shift(self, delta: Array) -> None:
        """Move the estimate by an error (D,)."""
        self.vehicle = self.vehicle.shifted(delta)
        shift = delta[LENS] * radial_shift(self._camera, self.image_points)
        self.image_points = self.image_points + (delta[SIZE:].reshape(-1, 3) + shift)

    def _straight(self, pixels: Array) -> Array:
        """Observed image points (n, 3), freed of distortion."""
        y = self._observation.image_points(pixels)
        return y + self.vehicle.kappa * radial_shift(self._camera, y)

    def _image_points_of(self, slots: Slots) -> ImagePoints:
        return image_points_in(self._state, self.image_points[slots], slots, self.T_world_body)

    def _told(self, points: ImagePoints, slots: Slots) -> ImagePoints:
        """Landmarks for the map: those of the belief in a bias and of that in none."""
        return points_of_both(self._camera, points, self._state.rows_of(slots), self._belief())

    def _belief(self) -> BiasBelief:
        if self._believed is None:
            prior = self._settings.gyro_bias_std**2
            bias, temper = self.vehicle.gyro_bias, self._track_noise.observations_per_independent
            self._believed = bias_belief(self.covariance, GYRO_BIAS, bias, prior, temper=temper)
        return self._believed

    def _has_position(self) -> NDArray[np.bool_]:
        return has_position(self.image_points, self._state.landmark_covariances())


register_estimator(
    "robocentric",
    RobocentricSettings,
    lambda settings, given: RobocentricFilter(settings, given.camera, given.tape),
    smoothable=True,
    unused=("process_noise", "process_variance"),  # the walk of the twist stands for them
)
