# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The steps of a drive without a filter: which are frozen, and what images say of the motion."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.motion import Increment, mean_twist
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.tracking.pairing import PredictedPath
from vislam_ros.core.tracking.tracks import Tracks
from vislam_ros.core.verdict.contradiction import contradictions
from vislam_ros.core.verdict.evidence import Evidence, Looks
from vislam_ros.core.verdict.reason import Reason
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Walk:
    """What the steps amount to.

    Attributes
    ----------
    steps : int
        Frames whose motion is known.
    frozen : ndarray of int64, (n,)
        Frames that repeat the last one's pixels while the body moves.
    looks : Looks
        Steps of which the images were looked at.
    reasons : tuple of Reason
        What the images say against motion or calibration.
    """

    steps: int
    frozen: NDArray[np.int64]
    looks: Looks
    reasons: tuple[Reason, ...]


def walk(drive: Drive) -> Walk:
    """Go over a drive, as a session does, by its dead reckoning."""
    settings = SlamSettings()
    path = PredictedPath(settings)
    reckoning = DeadReckoning(PredictionSettings())
    for stamp, twist in zip(drive.twist_stamps.tolist(), drive.twists, strict=True):
        for told in reckoning.add_motion(stamp, twist):
            T = se3.pose_matrix(told.position, told.quaternion)
            path.add(told.stamp, T, velocity_known=told.velocity_known)
    tracks, rate, evidence = Tracks.of(settings), FrameRate(), Evidence()
    frozen, steps, last = [], 0, None
    velocity = np.zeros(3)
    for k, stamp in enumerate(drive.feature_stamps.tolist()):
        if not len(drive.twists) or path.begins_after(stamp) or not path.reaches(stamp):
            continue
        increment = Increment(np.eye(4), 0.0, np.zeros((6, 6)))
        if last is not None:
            increment = path.increment(last, stamp, rate.usual)
        ids, pixels = drive.frame(k)

        before = tracks.last_pixels().astype(float)[:, [0, 2, 1]]
        moves = partial(_moves, drive.camera, before, increment, velocity)
        seen = tracks.observe(ids, pixels, moves, missed=rate.enter(increment.duration))
        if seen.frozen:
            frozen.append(k)
        evidence.add(stamp, ids, pixels, increment, drive.camera, frozen=seen.frozen)
        if increment.duration and increment.measures_velocity:
            velocity = mean_twist(increment).mean[:3]
        last, steps = stamp, steps + 1
    return Walk(
        steps,
        np.array(frozen, dtype=np.int64),
        evidence.looks,
        tuple(contradictions(evidence.pairs(), drive.camera)),
    )


def _moves(camera: StereoCamera, before: Array, increment: Increment, velocity: Array) -> bool:
    """Whether a motion moves the last frame's points (n, 3) noticeably."""
    if not len(before):
        return False
    return camera.median_flow(before, increment.moved_at(velocity)) > SlamSettings().frozen_motion


def judge_frozen_steps(drive: Drive, walked: Walk) -> Finding | None:
    """Tell how many steps are frozen; None where none is."""
    if not len(walked.frozen):
        return None
    share = len(walked.frozen) / walked.steps
    since = (drive.feature_stamps[walked.frozen] - drive.feature_stamps[0]) / NANOSECONDS
    return Finding(
        "frozen_steps",
        f"{len(walked.frozen)} of {walked.steps} frames ({share:.1%}) repeat the last pixels "
        "while the body moves",
        "copies are not used, their tracks begin anew (track_continuity)",
        True,
        {"frozen": len(walked.frozen), "share": share, "first_s": since[:20].tolist()},
    )
