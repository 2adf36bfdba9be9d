# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive estimated offline, just as the graph would: same core, same numbers handed over."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import threadpoolctl
from numpy.typing import NDArray

from vislam_ros.core.filters.dead_reckoning import DeadReckoning, Prediction
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.smoothing.smoothed_drive import SmoothedDrive
from vislam_ros.core.step import SlamStep
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import Trajectory


@dataclass(frozen=True)
class Solution:
    """What the estimators made of a drive.

    Attributes
    ----------
    steps : tuple of SlamStep
        One for each feature frame that was not refused.
    dead_reckoning : Trajectory
    landmarks : LandmarkMap
        The map after the last step; the exact one where the drive was smoothed.
    refused : dict of str to int
        Refused messages by reason; those of twists begin with ``twist_``.
    resets : int
        How often the SLAM estimate began anew.
    smoothed : SmoothedDrive or None
        Of the steps since then, where it was asked for.
    """

    steps: tuple[SlamStep, ...]
    dead_reckoning: Trajectory
    landmarks: LandmarkMap
    refused: dict[str, int]
    resets: int
    smoothed: SmoothedDrive | None = None

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the steps."""
        return trajectory_of(self.steps)


def trajectory_of(poses: Sequence[SlamStep] | Sequence[Prediction]) -> Trajectory:
    """Poses of steps or of predictions."""
    return Trajectory(
        np.array([pose.stamp for pose in poses], dtype=np.int64),
        np.array([pose.position for pose in poses]).reshape(-1, 3),
        np.array([pose.quaternion for pose in poses]).reshape(-1, 4),
    )


def covariances_of(steps: Sequence[SlamStep]) -> NDArray[np.float64]:
    """Covariances (n, 6, 6) of the steps' poses, in the body frame."""
    return np.array([step.covariance for step in steps])


def smoothed_trajectory(smoothed: SmoothedDrive) -> Trajectory:
    """Poses of a smoothed drive."""
    return Trajectory(smoothed.stamps, smoothed.positions, smoothed.quaternions)


def feed(
    drive: Drive, reckoning: DeadReckoning, slam: Slam
) -> Iterator[tuple[Prediction | None, list[SlamStep]]]:
    """Give a session a drive, message by message in the order of the stamps.

    Yields
    ------
    prediction : Prediction or None
        What a twist made; None after features, and after a twist that was refused.
    steps : list of SlamStep
        The steps that became ready.
    """
    # Sorting is stable, so the twist of a stamp comes before its features.
    stamps = np.concatenate([drive.twist_stamps, drive.feature_stamps])
    for place in np.argsort(stamps, kind="stable").tolist():
        k = place - len(drive.twist_stamps)
        if k >= 0:
            yield None, slam.add_features(int(drive.feature_stamps[k]), *drive.frame(k))
            continue
        prediction = reckoning.add_twist(int(drive.twist_stamps[place]), drive.twists[place])
        if prediction is None:
            yield None, []
        else:
            yield (
                prediction,
                slam.add_prediction(prediction.stamp, prediction.position, prediction.quaternion),
            )


def solve(
    drive: Drive,
    slam_settings: SlamSettings,
    prediction_settings: PredictionSettings,
    *,
    given_map: LandmarkMap | None = None,
    smooth: bool = False,
    on_prediction: Callable[[Prediction], None] | None = None,
    on_step: Callable[[SlamStep], None] | None = None,
) -> Solution:
    """Feed a drive to the estimators in the order of its stamps, a twist before features.

    Predictions reach the SLAM session as position and quaternion, as a message carries them, so
    the trajectory equals the live graph's to the last bit. BLAS is kept to one thread, which is
    fastest for matrices of this size.

    Parameters
    ----------
    drive : Drive
    slam_settings, prediction_settings : SlamSettings, PredictionSettings
    given_map : LandmarkMap, optional
        The map of the estimator ``localization``.
    smooth : bool, optional
        Whether to go back over the drive at its end, for smoothed poses and the exact map.
    on_prediction, on_step : callable, optional
        Hear each result as it comes.

    Raises
    ------
    SettingsError
        Where the estimator needs a map and none is given, or cannot be smoothed and should be.
    """
    reckoning = DeadReckoning(prediction_settings)
    slam = Slam(slam_settings, given_map, record=smooth)
    predictions: list[Prediction] = []
    steps: list[SlamStep] = []

    with threadpoolctl.threadpool_limits(1):
        slam.set_camera(drive.camera)
        for prediction, ready in feed(drive, reckoning, slam):
            if prediction is not None:
                predictions.append(prediction)
                if on_prediction:
                    on_prediction(prediction)
            steps += ready
            if on_step:
                for step in ready:
                    on_step(step)
        smoothed = slam.smoothed() if smooth else None
        landmarks = slam.landmarks() if smoothed is None else smoothed.landmarks
    return Solution(
        steps=tuple(steps),
        dead_reckoning=trajectory_of(predictions),
        landmarks=landmarks,
        refused={
            **{f"twist_{reason}": count for reason, count in reckoning.refused.items()},
            **slam.refused,
        },
        resets=slam.resets,
        smoothed=smoothed,
    )
