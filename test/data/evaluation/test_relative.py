# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors over stretches of the path, beside a plain loop over them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.relative import stretch_errors
from vislam_ros.data.simulation.motion import drive_poses
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]


def path(steps: int, noise: float = 0.0) -> Trajectory:
    """A car's path, whose steps are wrong by noise."""
    T = drive_poses(steps, 0.1, np.random.default_rng(0))
    moved = se3.inverse(T[:-1]) @ T[1:]
    moved = moved @ se3.exp(noise * np.random.default_rng(1).standard_normal((steps - 1, 6)))
    poses = [T[0]]
    for step in moved:
        poses.append(poses[-1] @ step)
    return Trajectory.from_matrices(np.arange(steps) * 100_000_000, np.array(poses))


def plain_errors(reference: Trajectory, estimate: Trajectory, lengths: list[float]) -> Array:
    """Metres and radians, one stretch after the other."""
    errors = []
    true, found = reference.T_world_body, estimate.T_world_body
    for length in lengths:
        for begin in range(0, len(true), 10):
            way, end = 0.0, begin
            while end + 1 < len(true) and way < length - 1e-9:
                way += float(np.linalg.norm(true[end + 1, :3, 3] - true[end, :3, 3]))
                end += 1
            if way < length - 1e-9:
                continue
            truly = np.linalg.inv(true[begin]) @ true[end]
            estimated = np.linalg.inv(found[begin]) @ found[end]
            error = np.linalg.inv(estimated) @ truly
            angle = np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1))
            errors.append((np.linalg.norm(error[:3, 3]), angle))
    return np.array(errors)


@pytest.mark.parametrize(("steps", "is_long"), [(60, False), (250, True)])
def test_the_errors_are_those_of_a_plain_loop_over_stretches(steps: int, is_long: bool) -> None:
    reference, estimate = path(steps), path(steps, 0.01)
    positions = reference.positions
    way = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    assert (way > 100.0) == is_long
    lengths = [50.0 * k for k in range(1, 9)] if is_long else [way * k / 8 for k in range(1, 7)]
    stretches = stretch_errors(reference.T_world_body, estimate.T_world_body)
    plain = plain_errors(reference, estimate, lengths)
    assert_allclose(stretches.metres, plain[:, 0], rtol=1e-6)
    assert_allclose(stretches.radians, plain[:, 1], rtol=1e-6)
    assert_allclose(np.unique(stretches.lengths), lengths[: len(np.unique(stretches.lengths))])
    assert stretches.metres.min() > 0.0

    rows = stretches.by_length()
    assert [row["length_m"] for row in rows] == np.unique(stretches.lengths).tolist()
    counts = np.array([row["stretches"] for row in rows])
    means = np.array([row["translation_percent"] for row in rows])
    figures = stretches.figures()
    assert figures is not None
    assert figures["stretches"] == counts.sum() == len(plain)
    assert figures["translation_percent"] == pytest.approx((counts * means).sum() / counts.sum())
    first = stretches.lengths == lengths[0]
    assert rows[0]["rotation_deg_per_100m"] == pytest.approx(
        np.rad2deg(plain[first, 1].mean()) / lengths[0] * 100
    )


@pytest.mark.parametrize("steps", [60, 250])
def test_the_reference_has_no_error_wherever_it_stands(steps: int) -> None:
    reference = path(steps)
    elsewhere = se3.exp([3.0, -2.0, 1.0, 0.3, 0.2, -1.0]) @ reference.T_world_body
    stretches = stretch_errors(reference.T_world_body, elsewhere)
    assert len(stretches.metres) == len(stretches.lengths) > 10
    assert_allclose(stretches.metres, 0.0, atol=1e-9)
    assert_allclose(stretches.radians, 0.0, atol=1e-7)


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_reference_that_stands_has_no_stretch(noise: float) -> None:
    standing = np.tile(np.eye(4), (30, 1, 1))
    standing[:, :3, 3] += noise * np.random.default_rng(2).standard_normal((30, 3))
    stretches = stretch_errors(standing, path(30).T_world_body)
    assert stretches.figures() is None
    assert stretches.by_length() == []


@pytest.mark.parametrize(("reach", "has_stretches"), [(0.099, False), (0.101, True)])
def test_a_path_of_more_than_a_tenth_of_a_metre_has_stretches_that_long(
    reach: float, has_stretches: bool
) -> None:
    T = np.tile(np.eye(4), (101, 1, 1))
    # Back and forth five times: the path is ten times as long as its reach.
    T[:, 0, 3] = reach * np.abs((np.arange(101) / 10 + 1) % 2 - 1)
    stretches = stretch_errors(T, T)
    assert bool(len(stretches.lengths)) == has_stretches
    assert all(stretches.lengths >= 0.1)
