# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions and tracked frames of a simulated drive, as the SLAM session hands them to a filter."""

import itertools
from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.filters.estimator import Estimator, Outcome
from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.tracking.pairing import PredictedPath
from vislam_ros.core.tracking.tracked_frame import TrackedFrame
from vislam_ros.core.tracking.tracks import Tracks
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate


def gappy_drive(settings: SimulationSettings, lost_share: float = 0.1) -> Drive:
    """Simulate a drive and lose some of its observations, so that landmarks come back."""
    drive = simulate(settings).drive
    seen = np.random.default_rng(settings.seed).random(len(drive.ids)) >= lost_share
    offsets = np.concatenate([[0], np.cumsum(seen)])[drive.offsets]
    return Drive(
        name=drive.name,
        camera=drive.camera,
        image_size=drive.image_size,
        twist_stamps=drive.twist_stamps,
        twists=drive.twists,
        feature_stamps=drive.feature_stamps,
        offsets=offsets,
        ids=drive.ids[seen],
        pixels=drive.pixels[seen],
    )


def trying_drive(steps: int, landmarks: int, seed: int, **others: float) -> Drive:
    """Simulate sliding tracks, frozen steps and landmarks that come back, all in a short drive."""
    settings = SimulationSettings(
        steps=steps,
        landmarks=landmarks,
        seed=seed,
        frozen_share=0.06,
        outlier_share=0.1,
        **others,  # type: ignore[arg-type]
    )
    drive = gappy_drive(settings)
    assert len(returning_ids(drive)) > landmarks // 6
    return drive


def trying_drives(steps: int, landmarks: int, seed: int) -> dict[str, Drive]:
    """Simulate it with white pixel noise, and with disparities that keep their errors."""
    offsets = {"pixel_noise_std": 0.05, "disparity_offset_std": 0.6}
    return {
        "white": trying_drive(steps, landmarks, seed),
        "offsets": trying_drive(steps, landmarks, seed, **offsets),
    }


def increments(drive: Drive, settings: SlamSettings) -> list[Increment]:
    """Predicted motion before each frame."""
    reckoning = DeadReckoning(PredictionSettings(time_jump=settings.time_jump))
    path = PredictedPath(settings)
    for stamp, twist in zip(drive.twist_stamps.tolist(), drive.twists, strict=True):
        for pose in reckoning.add_motion(stamp, twist):
            T = se3.pose_matrix(pose.position, pose.quaternion)
            path.add(pose.stamp, T, velocity_known=pose.velocity_known)
    standing = Increment(np.eye(4), 0.0, np.zeros((6, 6)))
    stamps = drive.feature_stamps.tolist()
    return [standing, *(path.increment(a, b, 0.1) for a, b in itertools.pairwise(stamps))]


def run(
    estimator: Estimator, drive: Drive, settings: SlamSettings
) -> Iterator[tuple[Increment, TrackedFrame, Outcome]]:
    """Drive a filter step by step; each step's input and outcome."""
    tracks = Tracks(settings.retire_after, settings.frozen_share, settings.rest_after_rejection)
    for k, increment in enumerate(increments(drive, settings)):
        frame = tracks.observe(
            *drive.frame(k), motion_expected=partial(bool, k > 0), noise=drive.noise_of(k)
        )
        outcome = estimator.step(increment, frame)
        tracks.restart(outcome.rejected, rest=outcome.agrees_with_most)
        yield increment, frame, outcome


def returning_ids(drive: Drive) -> NDArray[np.uint32]:
    """Ids that are unseen in some frame between two in which they are seen."""
    step = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    ids, counts = np.unique(drive.ids, return_counts=True)
    first = np.array([step[drive.ids == i].min() for i in ids])
    last = np.array([step[drive.ids == i].max() for i in ids])
    return ids[counts < last - first + 1]
