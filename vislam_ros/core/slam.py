# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The SLAM session: predictions and features in, in whatever order they come; steps out.

The same session runs in the node and in ``vislam solve``. What it computes depends on the stamps
and values alone, never on when a message happened to arrive.
"""

import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.filters.estimator import Estimator, Pose, require_possible, tune
from vislam_ros.core.filters.flat_settings import completed
from vislam_ros.core.filters.registry import Surroundings, estimator_named
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.motion import Increment, mean_twist
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.smoothing.smoothed_drive import SmoothedDrive, smoothed_drive
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.core.step import SlamStep
from vislam_ros.core.tracking.pairing import PredictedPath
from vislam_ros.core.tracking.pending_frame import PendingFrame, PendingFrames
from vislam_ros.core.tracking.refusals import (
    Refusal,
    RefusalCounts,
    RefusedMessage,
    Stream,
    check_features,
    check_pose,
)
from vislam_ros.core.tracking.subset import chosen_tracks
from vislam_ros.core.tracking.time_order import Passes
from vislam_ros.core.tracking.tracks import Tracks
from vislam_ros.core.verdict.reason import Judgement
from vislam_ros.core.verdict.verdict import Verdict
from vislam_ros.errors import SettingsError, of_type

Array = NDArray[np.float64]


class Slam:
    """A SLAM session.

    Parameters
    ----------
    settings : SlamSettings, optional
        Of the chosen estimator; of its own ones, the defaults where they are not among these.
    given_map : LandmarkMap, optional
        The map of an estimator that needs one; the others do not look at it.
    record : bool, optional
        Whether to record what :meth:`smoothed` needs: some 15 (``joint``) or 50 kB a step.

    Attributes
    ----------
    settings : SlamSettings
        Of the next step; :meth:`change_settings` replaces them.
    refused : RefusalCounts
        Messages of predictions and features that were not used.
    resets : int
        How often the estimate began anew.
    previous_map : LandmarkMap or None
        The map that the estimate had when it last began anew, exact where the session records.
    previous_verdict : Judgement or None
        The verdict on it then.

    Raises
    ------
    SettingsError
        Where the estimator needs a map and none is given, or cannot be smoothed and should be.
    """

    def __init__(
        self,
        settings: SlamSettings | None = None,
        given_map: LandmarkMap | None = None,
        *,
        record: bool = False,
    ):
        settings = completed(settings or SlamSettings())
        self._registration = estimator_named(settings.estimator)
        if record:
            self._registration.require_smoothable()
        if self._registration.needs_map and given_map is None:
            raise SettingsError(
                f"estimator: {settings.estimator!r} needs a map; set map_file to one"
            )
        self._settings = self.settings = settings
        self._given_map = given_map if self._registration.needs_map else None
        self._record = record
        self._camera: StereoCamera | None = None
        self._rectification: PixelRectification | None = None
        self.refused = RefusalCounts()
        self.resets = 0
        self.previous_map: LandmarkMap | None = None
        self.previous_verdict: Judgement | None = None
        self._clear()

    def _clear(self, *, stands: bool | None = None) -> None:
        """Forget all messages and the estimate, but not the camera."""
        streams = Stream.PREDICTION, Stream.FEATURES
        time_jumps = dict.fromkeys(streams, self._settings.time_jump)
        self._passes = Passes(time_jumps, self.refused.add)
        self._paths: dict[int, PredictedPath] = {}
        self._stands = stands
        self._pending = PendingFrames(self._settings.max_pending)
        self._begin_pass(0)

    def _begin_pass(self, pass_number: int) -> None:
        self._pass = pass_number
        self._estimator: Estimator | None = None
        self._camera_in_use: StereoCamera | None = None
        self._rectification_in_use: PixelRectification | None = None
        self._tape = Tape() if self._record else None
        self._verdict: Verdict | None = None
        self._stamps: list[int] = []
        self._last_stamp: int | None = None
        self._velocity: Array = np.zeros(3)
        self._frame_rate = FrameRate()
        self._tracks = Tracks.of(self._settings)

    @property
    def waiting(self) -> tuple[int, ...]:
        """Stamps (ns) of the feature frames that are neither answered nor refused yet.

        They wait for their prediction, the camera, or a frame that confirms their stamp.
        """
        pending = (frame.stamp for frame in self._pending)
        return (*pending, *self._passes.held(Stream.FEATURES))

    @property
    def has_begun(self) -> bool:
        """Whether the present pass has had a frame, and with it its camera."""
        return self._estimator is not None

    @property
    def refused_if_over(self) -> RefusalCounts:
        """What will be refused besides if nothing more comes."""
        over = self._passes.refused_if_over()
        waits_for = Refusal.NO_CAMERA if self._camera is None else Refusal.NO_PREDICTION
        for frame in self._pending:
            over.add(Stream.FEATURES, waits_for, frame.stamp)
        return over

    def reset(self) -> None:
        """Begin anew with the next features message, as at the start."""
        self._keep_pass()
        for stamp in self.waiting:
            self.refused.add(Stream.FEATURES, Refusal.RESET, stamp)
        paths = list(self._paths.values())
        self._clear(stands=paths[-1].stands if paths else None)  # the odometry goes on
        self.resets += 1

    def _keep_pass(self) -> None:
        if self._estimator is not None:
            self.previous_map, self.previous_verdict = self.best_landmarks(), self.verdict()

    def change_settings(self, settings: SlamSettings) -> None:
        """Take other settings from the next step on, or raise as :meth:`require_possible`."""
        self.require_possible(settings)
        self.settings = settings

    def require_possible(self, settings: SlamSettings) -> None:
        """Raise a SettingsError where settings cannot be taken while the session runs."""
        require_possible(self._estimator, self.settings, settings)

    def set_camera(
        self, camera: StereoCamera, rectification: PixelRectification | None = None
    ) -> list[SlamStep]:
        """Tell the calibration, for which features wait; another holds from the next pass on.

        Parameters
        ----------
        camera : StereoCamera
        rectification : PixelRectification, optional
            What makes the pixels those of ``camera``, where they are not.

        Returns
        -------
        list of SlamStep
        """
        self._camera = of_type("camera", camera, StereoCamera, "one of StereoCamera.from_matrices")
        self._rectification = rectification
        return self._advance()

    def add_prediction(
        self,
        stamp: int,
        position: ArrayLike,
        quaternion: ArrayLike,
        *,
        velocity_known: bool = True,
    ) -> list[SlamStep]:
        """Take a predicted pose of the body in the odometry frame.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        position, quaternion : array_like, (3,), (4,)
            Metres; x, y, z, w.
        velocity_known : bool, optional
            Whether the velocity was measured; where not, only the rotation counts.

        Returns
        -------
        list of SlamStep
            The steps that became ready.
        """
        try:
            check_pose(position, quaternion)
        except RefusedMessage as error:
            self.refused.add(Stream.PREDICTION, error.refusal, stamp)
            return []
        message = se3.pose_matrix(position, quaternion), velocity_known
        entered = self._passes.enter(Stream.PREDICTION, stamp, message)
        for number, believed, (T_odom_body, known) in entered:
            stands = self._stands if number == 0 else None
            path = self._paths.setdefault(number, PredictedPath(self._settings, stands=stands))
            path.add(believed, T_odom_body, velocity_known=known)
        return self._advance()

    def add_features(
        self, stamp: int, ids: ArrayLike, pixels: ArrayLike, noise: ArrayLike | None = None
    ) -> list[SlamStep]:
        """Take the features of one stamp.

        Parameters
        ----------
        stamp : int
            Nanoseconds.
        ids : array_like of uint32, (n,)
        pixels : array_like of float32, (n, 4)
            ``u_left, v_left, u_right, v_right``.
        noise : array_like of float32, (n,), optional
            Standard deviation of each, where the source states it, pixels.

        Returns
        -------
        list of SlamStep
            The steps that became ready.
        """
        ids, pixels = np.asarray(ids, dtype=np.uint32), np.asarray(pixels, dtype=np.float32)
        stated = None if noise is None else np.asarray(noise, dtype=np.float32)
        try:
            check_features(ids, pixels, stated)
        except RefusedMessage as error:
            self.refused.add(Stream.FEATURES, error.refusal, stamp)
            return []
        chosen = chosen_tracks(ids, self._settings.feature_fraction, self._settings.seed)
        frame = ids[chosen], pixels[chosen], None if stated is None else stated[chosen]
        for number, entered, content in self._passes.enter(Stream.FEATURES, stamp, frame):
            if not self._pending.add(PendingFrame(number, entered, *content)):
                self.refused.add(Stream.FEATURES, Refusal.QUEUE_FULL, entered)
        return self._advance()

    def landmarks(self) -> LandmarkMap:
        """Return the whole map as it stands."""
        if self._estimator is None:
            return LandmarkMap.empty()
        if self._given_map is not None:
            return self._given_map
        keys, positions, covariances = self._estimator.landmarks()
        ids, generations = self._tracks.identity(keys)
        return LandmarkMap(ids, generations, positions, covariances)

    def smoothed(self) -> SmoothedDrive:
        """Smooth the steps since the estimate began, at any time; needs ``record``."""
        if self._tape is None:
            raise ValueError("nothing was recorded: the session needs record=True")
        keys = np.empty(0, dtype=np.int64)
        if self._estimator is not None:
            keys = self._estimator.landmarks()[0]
        return smoothed_drive(self._tape, self._stamps, keys, self.landmarks())

    def best_landmarks(self) -> LandmarkMap:
        """Return the exact map where the session records, and else the one that stands."""
        return self.landmarks() if self._tape is None else self.smoothed().landmarks

    def verdict(self) -> Judgement | None:
        """Judge the steps since the estimate began; None where there is none yet."""
        return None if self._verdict is None else self._verdict.judged(self._predicted_until())

    def present_verdict(self) -> Judgement | None:
        """Judge what is wrong at present, in the last half minute."""
        return None if self._verdict is None else self._verdict.present(self._predicted_until())

    def _predicted_until(self) -> int | None:
        path = self._paths.get(self._pass)
        return None if path is None else path.end

    def _advance(self) -> list[SlamStep]:
        """Take every waiting frame whose motion is known by now."""
        steps: list[SlamStep] = []
        while self._pending and self._camera is not None:
            frame = self._pending[0]
            path = self._paths.get(frame.pass_number)
            pass_is_over = self._passes.number(Stream.PREDICTION) > frame.pass_number
            covered = path is not None and path.reaches(frame.stamp)
            if not (covered or pass_is_over):
                break
            frame = self._pending.take()
            if covered and path is not None and not path.begins_after(frame.stamp):
                steps.append(self._step(frame, path))
            else:
                # No prediction that is still to come can tell where this frame was taken.
                self.refused.add(Stream.FEATURES, Refusal.NO_PREDICTION, frame.stamp)
        return steps

    def _step(self, frame: PendingFrame, path: PredictedPath) -> SlamStep:
        begin = time.perf_counter()
        if frame.pass_number != self._pass:
            self._keep_pass()
            self._paths = {n: p for n, p in self._paths.items() if n >= frame.pass_number}
            self._begin_pass(frame.pass_number)
            self.resets += 1
        self._take_settings()
        if self._last_stamp is None:
            increment = Increment(np.eye(4), 0.0, np.zeros((6, 6)))
        else:
            increment = path.increment(self._last_stamp, frame.stamp, self._frame_rate.usual)
        first = self._estimator is None
        if self._estimator is None or self._verdict is None:
            assert self._camera is not None
            self._camera_in_use, self._rectification_in_use = self._camera, self._rectification
            self._estimator = self._new_estimator(self._camera)
            if path.stands:
                self._estimator.T_world_body = path.start(frame.stamp)
            self._verdict = Verdict(self._camera)
        frame = frame.rectified(self._rectification_in_use)
        tracked = self._tracks.observe(
            *(frame.ids, frame.pixels),
            lambda: self._motion_expected(increment),
            missed=self._frame_rate.enter(increment.duration),
            noise=frame.noise,
        )
        outcome = self._estimator.step(increment, tracked)
        if self._given_map is None:
            # What contradicts a wrong estimate can mend it.
            self._tracks.restart(outcome.rejected, rest=outcome.agrees_with_most)
        self._verdict.add(
            frame.stamp, frame.ids, frame.pixels, increment, outcome, frozen=tracked.frozen
        )
        if self._record:
            self._stamps.append(frame.stamp)
        self._last_stamp = frame.stamp
        path.forget_before(frame.stamp)
        pose = outcome.pose or Pose(self._estimator.T_world_body, self._estimator.pose_covariance)
        T = pose.T_world_body
        twist = outcome.twist or mean_twist(increment)
        self._velocity = twist.mean[:3]
        return SlamStep(
            stamp=frame.stamp,
            frozen=tracked.frozen,
            active=self._estimator.active,
            used=outcome.used,
            rejected=len(outcome.rejected),
            observed=len(frame.ids),
            admitted=outcome.admitted,
            landmarks=self._estimator.landmark_count,
            nis=outcome.nis,
            nis_dof=outcome.nis_dof,
            tracks=self._tracks.ids_seen,
            first_of_pass=first,
            left_out=tracked.left_out,
            position=T[:3, 3].copy(),
            quaternion=se3.quaternion_from_rotation(T[:3, :3]),
            covariance=pose.covariance,
            twist=twist.mean,
            twist_covariance=twist.covariance,
            T_map_odom=T @ se3.inverse(path.pose(frame.stamp)),
            estimates=outcome.estimates,
            ms=(time.perf_counter() - begin) * 1e3,
        )

    def _take_settings(self) -> None:
        """Take the settings that were told since the last step."""
        if self._settings is not self.settings:
            self._settings = self.settings
            self._tracks.follow(self.settings)
            for path in self._paths.values():
                path.settings = self.settings
            tune(self._estimator, self.settings)

    def _new_estimator(self, camera: StereoCamera) -> Estimator:
        given = Surroundings(camera, self._tape, self._given_map, self._tracks.ids_of)
        return self._registration.made(self._settings, given)

    def _motion_expected(self, increment: Increment) -> bool:
        """Tell whether the predicted motion moves the last frame's pixels noticeably."""
        pixels, camera = self._tracks.last_pixels().astype(float), self._camera_in_use
        if camera is None or not len(pixels):
            return False
        flow = camera.median_flow(pixels[:, [0, 2, 1]], increment.moved_at(self._velocity))
        return flow > self._settings.frozen_motion
