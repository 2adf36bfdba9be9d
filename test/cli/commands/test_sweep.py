# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from signal import Signals
from typing import Any

import pytest

from vislam_ros.cli.main import main

GATES = ["--set", "slam_node.chi2_gate=9,25"]


def command(*argv: Any) -> int:
    return main(["sweep", *map(str, argv)])


def rows_of(directory: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (directory / "runs.jsonl").read_text().splitlines()]


def test_a_grid_over_a_drive_is_run_once_and_printed(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = (dataset, "--out", tmp_path / "sweep", "--jobs", 1, *GATES)
    assert command(*argv, "--reference", dataset.with_suffix(".tum")) == 0
    output = capsys.readouterr().out
    assert "chi2_gate" in output
    assert "ATE [m]" in output
    assert len(rows_of(tmp_path / "sweep")) == 2
    assert command(*argv, "--reference", dataset.with_suffix(".tum")) == 0
    assert "2 of 2 runs are done already" in capsys.readouterr().err


def test_a_smoothed_sweep_prints_the_smoothed_error(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = dataset.with_suffix(".tum")
    argv = (dataset, "--out", tmp_path / "sweep", "--jobs", 1, "--reference", reference)
    assert command(*argv, "--smooth") == 0
    assert "smoothed [m]" in capsys.readouterr().out
    assert rows_of(tmp_path / "sweep")[0]["smoothed_ate_m"] > 0


def test_a_file_says_what_flags_say_and_flags_go_over_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(
        "simulate: {steps: 20, landmarks: 50}\nseeds: 9\ngrid: {slam_node.chi2_gate: [9, 25]}\n"
    )
    assert command("--file", file, "--out", tmp_path / "by_file", "--seeds", 1, "--jobs", 1) == 0
    assert (
        command(
            *("--simulate", "--out", tmp_path / "by_flags", "--jobs", 1, *GATES),
            *("--set", "simulate.steps=20", "--set", "simulate.landmarks=50"),
        )
        == 0
    )
    by_file, by_flags = rows_of(tmp_path / "by_file"), rows_of(tmp_path / "by_flags")
    assert [row["key"] for row in by_file] == [row["key"] for row in by_flags]
    assert len(by_file) == 2


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "names no drive"),
        (["--simulate", "--reference", "truth.tum"], "keep one of the two"),
        (["--simulate", "--set", "slam_node.chi2_gate=[9"], "these are no values"),
        (["--simulate", "--set", "slam_node.chi2_gate=-9"], "out of range"),
        (["--simulate", "--set", "simulate.seed=9"], "is set by the seeds"),
        (["missing.npz"], "no such file"),
    ],
)
def test_what_cannot_be_swept_is_one_line(
    argv: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(*argv, "--out", tmp_path / "sweep") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert not (tmp_path / "sweep").exists()


def test_a_sweep_in_which_nothing_works_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = (
        "--simulate",
        "--set",
        "simulate.steps=20",
        "--set",
        "slam_node.estimator=localization",
    )
    assert command(*argv, "--out", tmp_path / "sweep", "--jobs", 1) == 1
    assert "not one run ended well" in capsys.readouterr().err


@pytest.mark.parametrize("way", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_sweep_that_is_stopped_keeps_what_it_has(way: Signals, tmp_path: Path) -> None:
    def command_line(seeds: int) -> list[str]:
        return [
            *(sys.executable, "-m", "vislam_ros.cli.main", "sweep", "--simulate"),
            *("--out", str(tmp_path), "--seeds", str(seeds), "--jobs", "1"),
            *("--set", "simulate.steps=25", "--set", "simulate.landmarks=60"),
        ]

    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    runs = tmp_path / "runs.jsonl"
    with subprocess.Popen(command_line(1000), env=environment, stderr=subprocess.PIPE) as sweep:
        deadline = time.monotonic() + 60
        while not (runs.exists() and runs.read_text().count("\n") >= 3):
            assert sweep.poll() is None, sweep.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.02)
        sweep.send_signal(way)
        errors = sweep.communicate(timeout=60)[1].decode()
    if way != signal.SIGKILL:
        assert sweep.returncode == 130
        assert errors.strip().splitlines()[-1] == "interrupted"
        assert "Traceback" not in errors
    kept = runs.read_text().count("\n")
    assert kept >= 3
    assert command("--simulate", "--out", tmp_path, "--seeds", kept, "--jobs", 1,
        "--set", "simulate.steps=25", "--set", "simulate.landmarks=60") == 0  # fmt: skip
    assert [row["seed"] for row in rows_of(tmp_path)] == list(range(kept))
