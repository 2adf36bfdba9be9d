# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive solved while its filter is watched, so that others can be given what the filter had."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.interleaving import cpu_clock
from benchmark.watched_slam import FilterStep, WatchedSlam
from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.smoothing.smoothed_drive import SmoothedDrive
from vislam_ros.core.step import SlamStep
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.association import associate_stamps
from vislam_ros.data.solving import feed, trajectory_of
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory


@dataclass(frozen=True)
class RecordedDrive:
    """What a filter had and what it made of it.

    Attributes
    ----------
    steps : tuple of SlamStep
    filter_steps : tuple of FilterStep
        One for each of the steps.
    step_seconds : ndarray, (T,)
        Processor time of each whole step.
    smoothed : SmoothedDrive or None
        Where it was asked for.
    """

    steps: tuple[SlamStep, ...]
    filter_steps: tuple[FilterStep, ...]
    step_seconds: NDArray[np.float64]
    smoothed: SmoothedDrive | None = None

    @property
    def trajectory(self) -> Trajectory:
        """Poses of the steps."""
        return trajectory_of(self.steps)


def record(
    drive: Drive,
    slam_settings: SlamSettings,
    prediction_settings: PredictionSettings,
    *,
    smooth: bool = False,
) -> RecordedDrive:
    """Feed a drive to the session as :func:`vislam_ros.data.solving.solve` does."""
    reckoning = DeadReckoning(prediction_settings)
    filter_steps: list[FilterStep] = []
    steps: list[SlamStep] = []
    seconds: list[float] = []
    slam = WatchedSlam(slam_settings, filter_steps.append, record=smooth)
    slam.set_camera(drive.camera)
    begin = cpu_clock()
    for _, ready in feed(drive, reckoning, slam):
        if ready:
            seconds += [(cpu_clock() - begin) / len(ready)] * len(ready)
            steps += ready
        begin = cpu_clock()
    return RecordedDrive(
        steps=tuple(steps),
        filter_steps=tuple(filter_steps),
        step_seconds=np.array(seconds),
        smoothed=slam.smoothed() if smooth else None,
    )


def first_steps(drive: Drive, count: int) -> Drive:
    """Cut a drive off after its first feature frames."""
    if count >= drive.steps:
        return drive
    last = drive.feature_stamps[count - 1]
    twists = drive.twist_stamps <= last
    return dataclasses.replace(
        drive.with_frames(drive.feature_stamps <= last),
        twist_stamps=drive.twist_stamps[twists],
        twists=drive.twists[twists],
    )


def twist_errors(
    drive: Drive, reference: Trajectory
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which twists (n,) a reference knows, and how far they are off (n, 6), m/s and rad/s.

    Parameters
    ----------
    drive : Drive
        With a twist at each pose of the reference.
    reference : Trajectory
        A step counts where it has the poses at both its ends.
    """
    rows, twists = associate_stamps(reference.stamps, drive.twist_stamps)
    consecutive = np.flatnonzero((np.diff(rows) == 1) & (np.diff(twists) == 1))
    i, k = rows[consecutive], twists[consecutive]
    T = reference.T_world_body
    tau = np.diff(drive.twist_stamps)[k] / NANOSECONDS
    moved = se3.log(se3.inverse(T[i]) @ T[i + 1]) / tau[:, None]
    return k + 1, drive.twists[k + 1] - moved


def given_gyro_bias(drive: Drive, reference: Trajectory) -> NDArray[np.float64]:
    """Bias (3,) that the angular velocities have on average against a reference, rad/s."""
    _, errors = twist_errors(drive, reference)
    return np.asarray(np.mean(errors[:, 3:], axis=0))
