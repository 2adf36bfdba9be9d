# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from benchmark.battery.errors import stretch_errors
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
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
    """One stretch after the other."""
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
            errors.append(float(np.linalg.norm((np.linalg.inv(estimated) @ truly)[:3, 3])))
    return np.array(errors)


@pytest.mark.parametrize(("steps", "is_long"), [(60, False), (250, True)])
def test_the_errors_are_those_of_a_plain_loop_over_stretches(steps: int, is_long: bool) -> None:
    reference, estimate = path(steps), path(steps, 0.01)
    positions = reference.positions
    way = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    assert (way > 100.0) == is_long
    lengths = [50.0 * k for k in range(1, 9)] if is_long else [way * k / 8 for k in range(1, 7)]
    errors, over = stretch_errors(reference, estimate)
    plain = plain_errors(reference, estimate, lengths)
    assert_allclose(errors, plain, rtol=1e-6)
    assert_allclose(np.unique(over), lengths[: len(np.unique(over))])
    assert errors.min() > 0.0


@pytest.mark.parametrize("steps", [60, 250])
def test_the_reference_has_no_error_wherever_it_stands(steps: int) -> None:
    reference = path(steps)
    elsewhere = se3.exp([3.0, -2.0, 1.0, 0.3, 0.2, -1.0]) @ reference.T_world_body
    errors, lengths = stretch_errors(
        reference, Trajectory.from_matrices(reference.stamps, elsewhere)
    )
    assert len(errors) == len(lengths) > 10
    assert_allclose(errors, 0.0, atol=1e-9)
