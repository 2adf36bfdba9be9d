# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import pytest
from benchmark.battery import measuring
from benchmark.battery.measuring import Battery, measure_battery, read_rows
from benchmark.battery.rows import BatteryRow, Recorded, Simulated
from benchmark.battery.trials import TrialSettings

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.errors import VislamError

ROWS: list[BatteryRow] = [Simulated("walk", 6), Recorded("0022"), Simulated("flight", 6)]


def battery(
    directory: Path, *, seed: int = 0, force: bool = False, beside: Path | None = None
) -> Battery:
    slam = RobocentricSettings(seed=seed)
    settings = TrialSettings(directory / "no drives", slam, PredictionSettings())
    return measure_battery(
        directory / "battery", ROWS, settings, seeds=2, jobs=2, force=force, beside=beside
    )


def test_each_trial_runs_once_and_rows_without_their_drive_are_left_out(
    tmp_path: Path, ran: list[str]
) -> None:
    first = battery(tmp_path)
    assert len(ran) == len(set(ran)) == 4
    (note,) = first.notes
    assert note.startswith("battery: 0022 is not in ")
    page = (tmp_path / "battery" / "table.md").read_text()
    assert note in page

    runs = tmp_path / "battery" / "runs.jsonl"
    lines = runs.read_text().splitlines(keepends=True)
    runs.write_text("".join(lines[:3]) + lines[3][:20])
    del ran[:]
    again = battery(tmp_path, force=True)
    assert ran == [json.loads(lines[3])["key"]]
    assert again == first
    assert (tmp_path / "battery" / "table.md").read_text() == page


def test_rows_of_other_settings_are_kept_unless_forced(tmp_path: Path, ran: list[str]) -> None:
    battery(tmp_path)
    with pytest.raises(VislamError, match=r"other settings or other code.*--force"):
        battery(tmp_path, seed=1)
    assert len(ran) == 4
    battery(tmp_path, seed=1, force=True)
    assert len(ran) == 8


def test_rows_of_other_code_are_not_mixed_with_these(
    tmp_path: Path, ran: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    battery(tmp_path)
    monkeypatch.setattr(measuring, "_MODULES", ())
    with pytest.raises(VislamError, match="other code"):
        battery(tmp_path)
    assert len(ran) == 4


def test_another_battery_is_put_beside(tmp_path: Path, ran: list[str]) -> None:
    battery(tmp_path / "before")
    runs = tmp_path / "before" / "battery" / "runs.jsonl"
    runs.write_text(runs.read_text().replace('"estimate_percent": 2.0', '"estimate_percent": 4.0'))
    after = battery(tmp_path / "after", beside=runs.parent)
    assert [row["to_beside"] for row in after.rows] == [0.5, 0.5]
    assert after.groups[-1]["to_beside"] == 0.5
    assert "| 4.00 | 0.50 |" in (tmp_path / "after" / "battery" / "table.md").read_text()


def test_a_folder_that_is_no_battery_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match=r"runs\.jsonl"):
        read_rows(tmp_path)
    (tmp_path / "runs.jsonl").write_text('{"key": "a", "error": null}\n[1]\n')
    with pytest.raises(VislamError, match=r"runs\.jsonl, line 2"):
        read_rows(tmp_path)
