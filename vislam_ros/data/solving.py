# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive estimated offline, just as the graph would: same core, same numbers handed over."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import threadpoolctl
from numpy.typing import NDArray

from vislam_ros.core.filters.dead_reckoning import DeadReckoning, Prediction
from vislam_ros.core.filters.flat_settings import completed, replaced, unused_note
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.smoothing.smoothed_drive import SmoothedDrive
from vislam_ros.core.step import KINDS, Row, SlamStep
from vislam_ros.core.tracking.refusals import RefusalCounts
from vislam_ros.core.verdict.reason import Judgement
from vislam_ros.data.drive import Drive
from vislam_ros.data.loading import load_drive
from vislam_ros.data.results.completeness import shortfall
from vislam_ros.data.results.summary import RunSummary, peak_rss_mb
from vislam_ros.data.trajectory import Trajectory, extent
from vislam_ros.errors import of_type


@dataclass(frozen=True)
class Solution:
    """What the estimators made of a drive.

    Attributes
    ----------
    trajectory : Trajectory
        Poses of the steps, with their covariances.
    dead_reckoning : Trajectory
        Poses of the prediction alone, likewise.
    landmarks : LandmarkMap
        The map after the last step; the exact one where the drive was smoothed.
    steps : mapping of str to ndarray
        The columns of ``steps.csv``, each with a number (T,) for each feature frame that was not
        refused; a table for ``pandas.DataFrame``.
    summary : dict
        As in ``summary.json``.
    refused : RefusalCounts
        Messages that the drive's reader and the estimators refused.
    verdict : Judgement or None
        Whether the estimate can be trusted, and why not; None where there is no step.
    smoothed : Trajectory or None
        Of the steps since the estimate last began anew, where it was asked for, with covariances.
    """

    trajectory: Trajectory
    dead_reckoning: Trajectory
    landmarks: LandmarkMap
    steps: Mapping[str, NDArray[Any]]
    summary: dict[str, Any]
    refused: RefusalCounts
    verdict: Judgement | None = None
    smoothed: Trajectory | None = None

    def __repr__(self) -> str:
        word = "none" if self.verdict is None else self.verdict.word.value
        smoothed = "" if self.smoothed is None else ", smoothed"
        return (
            f"<Solution of {self.summary['drive']!r} by {self.summary['estimator']}: "
            f"{len(self.trajectory)} poses, {extent(self.trajectory)}, {len(self.landmarks)} "
            f"landmarks{smoothed}; verdict {word}>"
        )


def trajectory_of(poses: Sequence[SlamStep] | Sequence[Prediction]) -> Trajectory:
    """Poses of steps or of predictions."""
    return Trajectory(
        np.array([pose.stamp for pose in poses], dtype=np.int64),
        np.array([pose.position for pose in poses]).reshape(-1, 3),
        np.array([pose.quaternion for pose in poses]).reshape(-1, 4),
        np.array([pose.covariance for pose in poses]).reshape(-1, 6, 6),
    )


def smoothed_trajectory(smoothed: SmoothedDrive) -> Trajectory:
    """Poses of a smoothed drive."""
    return Trajectory(
        smoothed.stamps, smoothed.positions, smoothed.quaternions, smoothed.covariances
    )


def feed(
    drive: Drive, reckoning: DeadReckoning, slam: Slam
) -> Iterator[tuple[Prediction | None, list[SlamStep]]]:
    """Give a session a drive, message by message in the order of the stamps.

    Yields
    ------
    prediction : Prediction or None
        What a twist made; None after features.
    steps : list of SlamStep
        The steps that became ready.
    """
    # Sorting is stable, so the twist of a stamp comes before its features.
    stamps = np.concatenate([drive.twist_stamps, drive.feature_stamps])
    for place in np.argsort(stamps, kind="stable").tolist():
        k = place - len(drive.twist_stamps)
        if k >= 0:
            stamp, noise = int(drive.feature_stamps[k]), drive.noise_of(k)
            yield None, slam.add_features(stamp, *drive.frame(k), noise)
            continue
        force = None if drive.accelerations is None else drive.accelerations[place]
        motion = int(drive.twist_stamps[place]), drive.twists[place], force
        for prediction in reckoning.add_motion(*motion):
            pose = prediction.stamp, prediction.position, prediction.quaternion
            known = prediction.velocity_known
            yield prediction, slam.add_prediction(*pose, velocity_known=known)


def solve(
    drive: Drive | Path | str,
    slam_settings: SlamSettings | None = None,
    prediction_settings: PredictionSettings | None = None,
    *,
    given_map: LandmarkMap | None = None,
    motion_source: str | None = None,
    smooth: bool = False,
    on_prediction: Callable[[Prediction], None] | None = None,
    on_step: Callable[[SlamStep], None] | None = None,
    **values: Any,
) -> Solution:
    """Feed a drive to the estimators in the order of its stamps, a twist before features.

    Predictions reach the SLAM session as position and quaternion, as a message carries them, so
    the trajectory equals the live graph's to the last bit. BLAS is kept to one thread, which is
    fastest for matrices of this size.

    Parameters
    ----------
    drive : Drive, Path or str
        A path is read as :func:`~vislam_ros.data.loading.load_drive` does.
    slam_settings, prediction_settings : SlamSettings, PredictionSettings, optional
    given_map : LandmarkMap, optional
        The map of an estimator that needs one, such as ``localization``.
    motion_source : {"auto", "twist", "gyro"}, optional
        What measures the motion, in place of what ``prediction_settings`` say.
    smooth : bool, optional
        Whether to go back over the drive at its end, for smoothed poses and the exact map.
    on_prediction, on_step : callable, optional
        Hear each result as it comes.
    **values
        Settings by name that are put over ``slam_settings``, such as ``estimator="joint"``.

    Raises
    ------
    SettingsError
        Where there is no such setting or estimator, the estimator needs a map and none is given,
        or it cannot be smoothed and should be.
    VislamError
        Where the drive cannot be read, or does not have the motion that is asked for, or an
        argument is of a wrong type.

    Warns
    -----
    UserWarning
        Why the results are not complete, as where there is no step; which setting is not used.
    """
    if isinstance(drive, (str, Path)):
        drive = load_drive(drive)
    of_type("drive", drive, Drive, "a Drive (of load_drive, simulate(...).drive) or its path")
    if given_map is not None:
        of_type("given_map", given_map, LandmarkMap, "a LandmarkMap, as a solution's landmarks")
    settings = completed(slam_settings or SlamSettings())
    if values:
        if note := unused_note({"estimator": settings.estimator, **values}):
            warnings.warn(note, stacklevel=2)
        settings = replaced(settings, **values)
    prediction_settings = prediction_settings or PredictionSettings()
    of_type("prediction_settings", prediction_settings, PredictionSettings, "PredictionSettings")
    drive = drive.moved_by(motion_source or prediction_settings.motion_source)
    reckoning = DeadReckoning(prediction_settings)
    slam = Slam(settings, given_map, record=smooth)
    summary = RunSummary(drive=drive.name, estimator=settings.estimator)
    predictions: list[Prediction] = []
    steps: list[SlamStep] = []
    rows: list[Row] = []

    with threadpoolctl.threadpool_limits(1):
        slam.set_camera(drive.camera)
        for prediction, ready in feed(drive, reckoning, slam):
            if prediction is not None:
                predictions.append(prediction)
                if on_prediction:
                    on_prediction(prediction)
            for step in ready:
                steps.append(step)
                rows.append(step.row())
                summary.add_step(rows[-1])
                if on_step:
                    on_step(step)
        verdict = slam.verdict()
        smoothed = slam.smoothed() if smooth else None
        landmarks = slam.landmarks() if smoothed is None else smoothed.landmarks
    refused = RefusalCounts()
    refused.merge(drive.refused)
    for part in (reckoning, slam):
        refused.merge(part.refused)
        refused.merge(part.refused_if_over)
    summary.landmarks, summary.tracks = len(landmarks), len(np.unique(landmarks.ids))
    summary.set_refused(refused)
    summary.resets = slam.resets
    summary.verdict = verdict
    summary.judge_lost_frames()
    summary.peak_rss_mb = peak_rss_mb()
    reason = shortfall(len(steps), summary.refused, summary.refused_first)
    summary.complete, summary.incomplete_reason = reason is None, reason
    if reason:
        warnings.warn(f"{drive.name}: incomplete: {reason}", stacklevel=2)
    return Solution(
        trajectory=trajectory_of(steps),
        dead_reckoning=trajectory_of(predictions),
        landmarks=landmarks,
        steps=_table(rows),
        summary=summary.as_dict(),
        refused=refused,
        verdict=summary.verdict,
        smoothed=None if smoothed is None else smoothed_trajectory(smoothed),
    )


def _table(rows: Sequence[Row]) -> dict[str, NDArray[Any]]:
    """Columns of rows with the same names; those of every step where there is no row."""
    names = rows[0] if rows else KINDS
    return {
        name: np.array([row[name] for row in rows], dtype=KINDS.get(name, float)) for name in names
    }
