# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimators and formats of a user's own, in a file of the current folder, by every command."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import REPOSITORY

from vislam_ros.data.results.reader import read_results

MINE = "my_estimator:MyEstimator"
FORMAT = """
import dataclasses
import vislam_ros as vi

def matches(path):
    return path.suffix == ".where"

def read(path):
    drive = vi.load_drive(path.read_text())
    return dataclasses.replace(drive, name="found")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an estimator and a format in it."""
    shutil.copy(REPOSITORY / "docs" / "examples" / "my_estimator.py", tmp_path)
    (tmp_path / "where_format.py").write_text(FORMAT)
    return tmp_path


def vislam(folder: Path, *argv: object) -> "subprocess.CompletedProcess[str]":
    """Run the installed command, which does not look into the current folder by itself."""
    command = Path(sys.executable).with_name("vislam")
    return subprocess.run(
        [command, *map(str, argv)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


def test_an_estimator_runs_live_as_it_does_offline(folder: Path, dataset: Path) -> None:
    (folder / "params.yaml").write_text(
        f"slam_node: {{ros__parameters: {{estimator: '{MINE}', pixel_std: 2, planar: true}}}}"
    )
    note = "planar: set, but not used by estimator my_estimator"
    for command in (("solve",), ("run", "--rate", "0", "--no-pictures")):
        done = vislam(folder, *command, dataset, "--params", "params.yaml", "--out", command[0])
        assert done.returncode == 0, done.stderr
        assert f"warning: slam_node: {note}" in done.stderr.splitlines()
    live, offline = read_results(folder / "run"), read_results(folder / "solve")
    tables = [(folder / name / "trajectory.tum").read_bytes() for name in ("run", "solve")]
    assert tables[0] == tables[1]
    assert live.summary["complete"]
    used = live.parameters["slam_node"]
    assert (used["estimator"], used["pixel_std"]) == (MINE, 2.0)
    assert used.items() >= offline.parameters["slam_node"].items()
    assert note in (folder / "run" / "log" / "slam_node.log").read_text()


def test_an_estimator_is_swept_in_processes_beside_one_of_the_package(
    folder: Path, dataset: Path
) -> None:
    sweep = ("sweep", dataset, "--out", "sweep", "--jobs", 2)
    done = vislam(
        folder,
        *sweep,
        *("--set", f"slam_node.estimator={MINE},joint", "--set", "slam_node.pixel_std=1,3"),
    )
    assert done.returncode == 0, done.stderr
    assert "pixel_std: set, but not used by estimator joint" in done.stderr
    lines = (folder / "sweep" / "runs.jsonl").read_text().splitlines()
    rows = [row for row in map(json.loads, lines) if "error" in row]
    assert len(rows) == 4
    assert [row["error"] for row in rows] == [None] * 4


def test_a_format_is_solved_and_converted(folder: Path, dataset: Path) -> None:
    (folder / "small.where").write_text(str(dataset))
    for argv in (
        ("solve", "small.where", "--format", "where_format", "--out", "results"),
        ("convert", "small.where", "small_bag", "--format", "where_format"),
    ):
        done = vislam(folder, *argv)
        assert done.returncode == 0, done.stderr
    assert read_results(folder / "results").summary["drive"] == "found"
    assert (folder / "small_bag" / "metadata.yaml").is_file()


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--estimator", "nowhere:Mine"), ["estimator: 'nowhere:Mine'", "cannot be imported"]),
        (("--estimator", "my_estimator:Yours"), ["estimator:", "'Yours'"]),
        (("--format", "nowhere"), ["nowhere cannot be imported"]),
    ],
)
def test_a_bad_one_is_one_line(
    folder: Path, dataset: Path, flags: tuple[str, ...], words: list[str]
) -> None:
    done = vislam(folder, "solve", dataset, "--out", "results", *flags)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    for word in words:
        assert word in line
