# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.evaluation.laid_paths import laid_paths
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError


def test_without_a_reference_paths_stay_where_they_are(round_results: Results) -> None:
    laid = laid_paths(round_results)
    assert [path.name for path in laid.paths] == ["estimate", "dead reckoning"]
    assert laid.paths[0].positions is round_results.trajectory.positions
    assert all(path.rmse is None for path in laid.paths)


@pytest.mark.parametrize("align", ["se3", "yaw", "none"])
def test_errors_are_those_of_the_evaluation(
    round_results: Results, moved_round: Trajectory, align: str
) -> None:
    laid = laid_paths(round_results, moved_round, align)  # type: ignore[arg-type]
    for name, path in (
        ("estimate", round_results.trajectory),
        ("dead reckoning", round_results.dead_reckoning),
    ):
        figures = compare(moved_round, path, align=align)  # type: ignore[arg-type]
        found = laid.get(name)
        assert found is not None
        assert found.rmse == pytest.approx(figures["ate_m"]["rmse"], abs=1e-12)


def test_the_estimate_and_its_map_stay_and_the_reference_comes(
    round_results: Results, round_drive: Trajectory, moved_round: Trajectory
) -> None:
    laid = laid_paths(round_results, moved_round, "first")
    estimate, dead_reckoning, reference = laid.paths
    np.testing.assert_array_equal(estimate.positions, round_drive.positions)
    np.testing.assert_allclose(reference.positions, round_drive.positions, atol=1e-9)
    np.testing.assert_allclose(dead_reckoning.positions[0], [0.0, 0.0, 0.0], atol=1e-9)
    assert laid.get("smoothed") is None


def test_of_a_longer_reference_the_part_that_is_compared_is_laid(
    round_results: Results, round_drive: Trajectory
) -> None:
    part = round_drive.between(np.array([0, 20]))
    laid = laid_paths(replace(round_results, trajectory=part, dead_reckoning=None), round_drive)
    np.testing.assert_array_equal(laid.paths[-1].stamps, part.stamps)
    assert laid.laying.endswith("; 40.0 m of its 118 m")


def test_an_unknown_laying_is_refused(round_results: Results, moved_round: Trajectory) -> None:
    with pytest.raises(VislamError, match="align is 'best'"):
        laid_paths(round_results, moved_round, "best")  # type: ignore[arg-type]
