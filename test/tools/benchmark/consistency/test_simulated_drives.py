# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The Monte-Carlo table says what the drives said."""

from typing import Any

import numpy as np
import pytest
from benchmark.consistency.simulated_drives import CELLS, Cell, MonteCarlo, spread, summary

from vislam_ros.core.filters.flat_settings import replaced
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import solve

CELL = Cell(0.1, 0.01, 0.1, steps=40, landmarks=200)


def figures(nees: float, ate_m: float, batch_m: float, batch_with_walk_m: float) -> dict[str, Any]:
    return {
        "filters": {"robocentric": {"nees": nees, "ate_m": ate_m}},
        "dead_reckoning_m": 9.0,
        "batch_m": batch_m,
        "batch_with_walk_m": batch_with_walk_m,
        "converged": True,
    }


def test_a_row_holds_means_over_the_drives_and_ratios_of_means() -> None:
    (row,) = summary([figures(0.5, 0.1, 0.1, 0.05), figures(1.5, 0.3, 0.3, 0.15)])
    assert row["name"] == "robocentric"
    assert row["drives"] == row["converged"] == 2
    assert row["nees"] == pytest.approx(1.0)
    assert row["nees_std_error"] == pytest.approx(0.5)
    assert row["ate_m"] == pytest.approx(0.2)
    assert row["to_batch"] == pytest.approx(1.0)
    assert row["to_batch_with_walk"] == pytest.approx(2.0)


def test_a_single_drive_has_no_standard_error() -> None:
    (row,) = summary([figures(0.5, 0.1, 0.1, 0.05)])
    assert row["nees_std_error"] is None


def test_the_spread_of_disparities_counts_the_small_ones() -> None:
    disparities = spread(np.arange(0.0, 10.1, 0.1))
    assert disparities["median_px"] == pytest.approx(5.0)
    assert disparities["twentieth_px"] == pytest.approx(0.5)
    assert disparities["small_share"] == pytest.approx(13 / 101)


def test_drives_are_those_of_all_four_kinds_each_with_a_bias_of_its_own() -> None:
    assert len(CELLS) == 4
    biases = np.array([cell.simulation(seed).gyro_bias for cell in CELLS for seed in range(5)])
    assert np.all((np.abs(biases) >= 0.002) & (np.abs(biases) <= 0.01))
    # The same in each kind, so that kinds can be compared.
    assert len(np.unique(biases, axis=0)) == 5
    assert CELLS[0].simulation(3) == CELLS[0].simulation(3)


def test_the_table_has_what_the_filters_made_of_each_drive() -> None:
    settings = RobocentricSettings()
    said: list[str] = []
    table = MonteCarlo(settings, PredictionSettings(), on_progress=said.append).run([9], [CELL])
    assert [row["name"] for row in table["runs"]] == ["robocentric", "smoothed", "joint"]
    assert len(said) == table["seeds"] == len(table["drives"]) == 1

    drive = simulate(CELL.simulation(9)).drive
    assert drive.ground_truth is not None
    joint = replaced(
        settings, estimator="joint", velocity_noise_std=0.1, angular_velocity_noise_std=0.01
    )
    for name, alone in (("robocentric", settings), ("joint", joint)):
        solution = solve(drive, alone, PredictionSettings())
        covariances = solution.trajectory.covariances
        expected = compare(drive.ground_truth, solution.trajectory, covariances)
        (row,) = (row for row in table["runs"] if row["name"] == name)
        assert row["nees"] == pytest.approx(expected["nees_per_dof"])
        assert row["ate_m"] == pytest.approx(expected["ate_m"]["rmse"])
    (drive_figures,) = table["drives"]
    assert drive_figures["converged"]
    assert 0 < drive_figures["batch_m"] < drive_figures["dead_reckoning_m"]
    assert 0 < drive_figures["batch_with_walk_m"] < drive_figures["dead_reckoning_m"]
