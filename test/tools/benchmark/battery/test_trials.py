# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
from benchmark.battery.rows import BatteryRow, Recorded, Simulated, all_rows
from benchmark.battery.trials import Trial, TrialSettings, drive_of, run_trial, trials_of

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings


def settings(data: Path = Path("nowhere")) -> TrialSettings:
    return TrialSettings(data, RobocentricSettings(), PredictionSettings())


def test_rows_are_solved_once_for_each_seed_but_once_where_nothing_is_drawn() -> None:
    rows = all_rows()
    trials = trials_of(rows, 3)
    assert len({trial.key for trial in trials}) == len(trials)
    plain = Recorded("0022")
    assert [trial.seed for trial in trials if trial.row == plain] == [0]
    drawn: list[BatteryRow] = [
        Recorded("0022", 33),
        Recorded("0022", 100, twist="clean"),
        Recorded("0020", sliding=10),
        Simulated("drive", 6),
    ]
    for row in drawn:
        assert [trial.seed for trial in trials if trial.row == row] == [0, 1, 2], row.name


def test_a_trial_gives_its_errors_and_they_are_those_of_its_seed() -> None:
    row = Simulated("walk", 6)
    first, other = (run_trial(settings(), Trial(row, seed)) for seed in (0, 1))
    assert first["error"] is other["error"] is None
    assert 0.0 < first["smoothed_percent"] < first["dead_reckoning_percent"] < 10.0
    assert first["estimate_m"] != other["estimate_m"]
    assert {"estimate_ate_m", "estimate_nees", "gyro_bias_x", "verdict"} <= first.keys()


def test_what_goes_wrong_is_said_in_the_row() -> None:
    row = run_trial(settings(), Trial(Recorded("0022"), 0))
    assert "nowhere/0022.npz" in row["error"]
    assert row["key"] == "0022, 100 %, seed 0"


@pytest.mark.parametrize(
    "row",
    [
        Recorded("0020", 100, 2),
        Recorded("0022", 3, twist="clean"),
        Recorded("0022", 3, twist="clean, biased", sliding=25),
    ],
    ids=lambda row: row.name,
)
def test_a_recorded_drive_is_changed_as_its_row_says(shared_data: Path, row: Recorded) -> None:
    plain, _ = drive_of(shared_data, Trial(Recorded(row.drive), 0))
    drive, reference = drive_of(shared_data, Trial(row, 0))
    assert (drive.steps < plain.steps) == (row.quarter > 0)
    if not row.quarter:
        assert np.array_equal(drive.twists, plain.twists) == (row.twist == "own")
        assert np.array_equal(drive.pixels, plain.pixels) == (not row.sliding)
    assert len(reference) > 100
