# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from benchmark.sensitivity.constants import Constant
from benchmark.sensitivity.drives import TrialDrive, load, recorded_drives, simulated_drives
from benchmark.sensitivity.summary import markdown, summary
from benchmark.sensitivity.trials import Trial, TrialSettings, run_trial, trials_of

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.sweeps.run import Row

SETTINGS = TrialSettings(RobocentricSettings(), PredictionSettings())
DRIVE = TrialDrive(
    "short",
    SimulationSettings(
        steps=60, landmarks=300, velocity_noise_std=0.5, angular_velocity_noise_std=0.05, seed=3
    ),
)
GATE = Constant("core.noise.track_noise", "_PRIOR_NUMBERS", (1.0, 600.0))


def test_trials_are_every_drive_as_it_is_and_with_each_value_of_each_constant() -> None:
    drives = simulated_drives(seeds=2)
    trials = trials_of([GATE], drives)
    assert len({trial.key for trial in trials}) == len(trials) == 3 * len(drives)
    assert [trial.value for trial in trials[:: len(drives)]] == [None, 1.0, 600.0]


def test_a_trial_changes_the_estimate_and_leaves_the_next_one_as_it_was() -> None:
    as_is, other, again = (
        run_trial(SETTINGS, trial)
        for trial in (Trial(DRIVE), Trial(DRIVE, GATE, 1.0), Trial(DRIVE))
    )
    assert as_is["error"] is other["error"] is None
    assert other["sha256"] != as_is["sha256"] == again["sha256"]
    assert 0 < as_is["ate_m"] < 1
    assert 0.1 < as_is["nees"] < 10
    # Most landmarks are where their covariances say.
    assert as_is["outside_percent"] < 20


def test_a_setting_is_varied_and_a_constant_of_loading_where_the_drive_is_read() -> None:
    as_is = run_trial(SETTINGS, Trial(DRIVE))
    setting = Constant("settings", "pixel_gate", (1e-9, 1.0))
    blind = run_trial(SETTINGS, Trial(DRIVE, setting, 1e-9))
    assert blind["ate_m"] > 2 * as_is["ate_m"]
    margin = Constant("data.datasets.conventions", "CLEARLY_SMALLER", (0.5, 1.0))
    assert run_trial(SETTINGS, Trial(DRIVE, margin, 0.5))["sha256"] == as_is["sha256"]


def test_what_goes_wrong_is_the_rows_error() -> None:
    unheard_of = Constant("core.noise.track_noise", "_NO_SUCH", (1.0, 2.0))
    row = run_trial(SETTINGS, Trial(DRIVE, unheard_of, 1.0))
    assert "_NO_SUCH" in row["error"]
    assert "ate_m" not in row


def test_recorded_drives_are_those_with_a_reference_whole_and_with_fewer_tracks(
    tmp_path: Path,
) -> None:
    for name in ("a", "b"):
        write_simulated(tmp_path / f"{name}.npz", simulate(SimulationSettings(20, 100)))
    (tmp_path / "b.tum").rename(tmp_path / "b_pseudo.tum")
    write_simulated(tmp_path / "c.npz", simulate(SimulationSettings(20, 100)))
    (tmp_path / "c.tum").unlink()
    drives = recorded_drives(sorted(tmp_path.glob("*.npz")))
    assert [drive.name.split(",")[0] for drive in drives] == ["a", "a", "b", "b"]
    assert [drive.feature_fraction for drive in drives] == [1.0, 0.33, 1.0, 0.33]
    assert drives[0].group == "recorded"
    assert load(drives[2]).drive.steps == 20


def row(drive: TrialDrive, value: float | None, ate: float, sha: str = "0") -> Row:
    constant = None if value is None else GATE
    key = Trial(drive, constant, value).key
    figures = {"ate_m": ate, "nees": 1.0, "error_percent": ate / 2, "landmarks": 10, "sha256": sha}
    return {"key": key, "error": None, **figures}


def test_a_summary_compares_each_value_with_the_same_drives_as_they_are() -> None:
    drives = [dataclasses.replace(DRIVE, name=name) for name in "ab"]
    rows = [row(drives[0], None, 1.0), row(drives[1], None, 100.0)]
    rows += [row(drives[0], 1.0, 2.0, "1"), row(drives[1], 1.0, 200.0, "1")]
    rows += [
        row(drives[0], 600.0, 1.0),
        {"key": Trial(drives[1], GATE, 600.0).key, "error": "bad"},
    ]
    as_is, doubled, unchanged = summary([GATE], drives, {row["key"]: row for row in rows})
    assert as_is["constant"] is None
    assert doubled["simulated"]["ate_ratio"] == pytest.approx(2.0)
    assert doubled["simulated"]["ate_ratio_std_error"] == pytest.approx(0.0)
    assert doubled["simulated"]["error_percent"] == pytest.approx(np.mean([1.0, 100.0]))
    assert doubled["simulated"]["changed"] == doubled["simulated"]["drives"] == 2
    assert unchanged["simulated"]["changed"] == 0
    assert unchanged["failed"] == ["bad"]
    table = markdown([as_is, doubled, unchanged]).splitlines()
    assert "recorded" not in table[0]
    assert "`core.noise.track_noise._PRIOR_NUMBERS` | 1 | 2 of 2 | 50.50 | 2.000" in table[3]
