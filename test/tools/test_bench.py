# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""tools/bench.py measures what it is asked to, once, and writes it down."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from bench import _parser
from places import REPOSITORY

from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

TOOL = REPOSITORY / "tools" / "bench.py"


def bench(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, TOOL, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


def test_the_step_is_measured_above_its_floor_and_written_as_json(tmp_path: Path) -> None:
    out = tmp_path / "bench.json"
    result = bench("--only", "floor", "--quick", "--estimator", "joint", "--out", out)
    assert result.returncode == 0, result.stderr
    assert "step / floor" in result.stdout
    report = json.loads(out.read_text())
    assert report["estimator"] == "joint"
    assert "dense" not in report
    assert {row["active"] for row in report["floor"]} == {66, 150}
    assert all(row["ratio"] > 0 and row["floor_ms"] > 0 for row in report["floor"])
    assert report["machine"]["blas"]

    again = bench("--only", "floor", "--quick", "--out", out)
    assert again.returncode == 1
    assert again.stderr.startswith("error:")
    assert "--force" in again.stderr


def of_a_drive(section: str, folder: Path, **simulation: Any) -> tuple[str, dict[str, Any]]:
    """What a section prints and writes about a simulated drive, its reference beside it."""
    data, out = folder / "drive.npz", folder / "bench.json"
    write_simulated(data, simulate(SimulationSettings(**simulation)))
    result = bench("--only", section, "--quick", "--data", data, "--out", out)
    assert result.returncode == 0, result.stderr
    return result.stdout, json.loads(out.read_text())


def test_a_drive_is_measured_with_the_reference_beside_it(tmp_path: Path) -> None:
    _, report = of_a_drive("drives", tmp_path, steps=40, landmarks=200)
    rows = report["drives"]
    assert rows[0]["steps"] == rows[1]["steps"] == 40
    assert all(row["ate_m"] > 0 for row in rows)


def test_a_drive_is_measured_beside_itself_with_other_noise(tmp_path: Path) -> None:
    printed, report = of_a_drive("redrawn", tmp_path, steps=60, landmarks=300)
    assert "other pixels and twists" in printed
    itself, *others = report["redrawn"]["runs"]
    assert [itself["drives"], *(row["drives"] for row in others)] == [1, 2, 2]
    assert all(row["nees_least"] <= row["nees"] <= row["nees_greatest"] for row in others)


def test_consistency_is_measured_on_drives_of_each_kind(tmp_path: Path) -> None:
    out = tmp_path / "bench.json"
    result = bench("--only", "consistency", "--quick", "--seeds", 1, "--out", out)
    assert result.returncode == 0, result.stderr
    assert "NEES/6" in result.stdout
    assert "disparities of consistency: median" in result.stdout
    consistency = json.loads(out.read_text())["consistency"]
    assert consistency["seeds"] == 1
    assert len(consistency["drives"]) == 4
    assert {row["name"] for row in consistency["runs"]} == {"robocentric", "smoothed", "joint"}
    assert all(row["nees"] > 0 and row["to_batch"] > 0 for row in consistency["runs"])


def test_the_battery_leaves_its_files_beside_the_report_and_goes_on_from_them(
    tmp_path: Path,
) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("slam_node:\n  ros__parameters:\n    estimator: robocentric\n")
    asked = ("--only", "battery", "--quick", "--params", params)
    result = bench(*asked, "--out", tmp_path / "bench.json")
    assert result.returncode == 0, result.stderr
    assert "estimate / dead reckoning" in result.stdout
    folder = tmp_path / "battery"
    rows = (folder / "runs.jsonl").read_text()
    report = json.loads((tmp_path / "bench.json").read_text())
    assert len(rows.splitlines()) == len(report["battery"]) >= 2
    assert report["battery_groups"][-1]["rows"] == len(report["battery"])
    assert all(0 < row["estimate_percent"] < 10 for row in report["battery"])
    assert (folder / "table.md").read_text().startswith("# The battery")
    assert (folder / "battery.png").read_bytes().startswith(b"\x89PNG")

    again = bench(*asked, "--beside", folder, "--out", tmp_path / "again.json")
    assert again.returncode == 0, again.stderr
    assert (folder / "runs.jsonl").read_text() == rows
    assert (
        json.loads((tmp_path / "again.json").read_text())["battery_groups"][-1]["to_beside"] == 1
    )


@pytest.mark.parametrize("name", ["battery", "ablation"])
def test_what_takes_long_runs_only_where_it_is_named(name: str) -> None:
    assert name not in _parser().parse_args([]).only
    assert _parser().parse_args(["--only", name]).only == [name]


def test_an_unknown_section_is_wrong_usage() -> None:
    result = bench("--only", "floor,roof")
    assert result.returncode == 2
    assert (
        "floor, dense, growth, drives, peers, consistency, tracks, redrawn, frontend, battery, "
        "ablation" in result.stderr
    )


def test_a_section_that_cannot_be_measured_is_left_out_with_the_reason(tmp_path: Path) -> None:
    data = tmp_path / "drive.npz"
    write_simulated(data, simulate(SimulationSettings(steps=30, landmarks=100))).unlink()
    out = tmp_path / "bench.json"
    asked = ("--only", "tracks,peers", "--estimator", "dead_reckoning", "--quick")
    result = bench(*asked, "--data", data, "--out", out)
    assert result.returncode == 0, result.stderr
    assert json.loads(out.read_text())["notes"] == [
        "peers is left out: it needs --reference for its errors",
        "tracks is left out: dead_reckoning cannot be smoothed",
    ]


def test_the_help_names_every_section_and_what_it_measures() -> None:
    result = bench("--help")
    assert "dense        The dense filter over 500, 1000 and 2000 landmarks" in result.stdout
