# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the battery does to a recorded drive: a part of it, another twist, tracks that slide."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from benchmark.recorded_drive import twist_errors
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

# White noise of a clean twist, metres and radians a second, and its bias, where it has one.
_CLEAN_STD = np.repeat([0.03, 0.003], 3)
_BIAS = 0.01
# How far what slides moves in a frame [px]: mostly sideways, as traffic does.
_SLOWEST, _FASTEST = 2.0, 6.0


def quarter_of(drive: Drive, quarter: int) -> Drive:
    """One of four parts of a drive, counted from 1."""
    bounds = np.linspace(0, drive.steps, 5).astype(int)
    first, last = bounds[quarter - 1], bounds[quarter]
    begin, end = drive.feature_stamps[first], drive.feature_stamps[last - 1]
    twists = (drive.twist_stamps >= begin) & (drive.twist_stamps <= end)
    return dataclasses.replace(
        drive.with_frames((drive.feature_stamps >= begin) & (drive.feature_stamps <= end)),
        twist_stamps=drive.twist_stamps[twists],
        twists=drive.twists[twists],
    )


def with_clean_twist(
    drive: Drive, reference: Trajectory, rng: np.random.Generator, *, biased: bool
) -> Drive:
    """Put a twist in place of the measured one: the reference's, with little noise.

    What the reference does not know keeps the nearest twist that it knows.
    """
    known, errors = twist_errors(drive, reference)
    true = drive.twists[known] - errors
    stamps = drive.twist_stamps
    places = np.clip(np.searchsorted(stamps[known], stamps), 0, len(known) - 1)
    twists = true[places] + _CLEAN_STD * rng.standard_normal(drive.twists.shape)
    if biased:
        twists[:, 3:] += _BIAS * np.sign(rng.standard_normal(3))
    return dataclasses.replace(drive, twists=twists)


def with_sliding_tracks(drive: Drive, share: float, rng: np.random.Generator) -> Drive:
    """Let a share of the tracks slide over the scene, each in one direction, in both images."""
    tracks, which = np.unique(drive.ids, return_inverse=True)
    frames = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    first = np.full(len(tracks), drive.steps)
    np.minimum.at(first, which, frames)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(tracks))
    speed = rng.uniform(_SLOWEST, _FASTEST, len(tracks)) * (rng.random(len(tracks)) < share)
    slide = speed[:, None] * np.column_stack([np.cos(angle), 0.3 * np.sin(angle)])
    moved: Array = slide[which] * (frames - first[which])[:, None]
    pixels = drive.pixels + np.hstack([moved, moved]).astype(np.float32)
    return dataclasses.replace(drive, pixels=pixels)
