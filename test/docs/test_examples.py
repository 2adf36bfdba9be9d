# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The examples and the snippets of the documentation run, and end where they say."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import REPOSITORY

import vislam_ros as vi
from vislam_ros.cli.main import main
from vislam_ros.data.results.reader import read_results

DOCS = REPOSITORY / "docs"
EXAMPLES = DOCS / "examples"


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")


def run(*words: object) -> str:
    """What a program prints, as a user runs it: what it registers goes with it."""
    result = subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def numbers(pattern: str, text: str) -> list[float]:
    return [float(number) for number in re.findall(pattern, text)]


def test_a_drive_is_solved_and_drawn() -> None:
    text = run(EXAMPLES / "solve_a_drive.py")
    dead_reckoning, filtered, smoothed = numbers(r"ATE ([\d.]+) m", text)
    assert smoothed <= filtered < dead_reckoning
    assert Path("drive.png").stat().st_size > 1000


def test_tracks_of_your_own_are_solved() -> None:
    dead_reckoning, estimate = numbers(
        r"off by ([\d.]+) m", run(EXAMPLES / "tracks_of_your_own.py")
    )
    assert estimate < 0.2 * dead_reckoning


def test_an_estimator_of_your_own_is_better_than_none() -> None:
    dead_reckoning, mine, robocentric = numbers(
        r"ATE ([\d.]+) m", run(EXAMPLES / "my_estimator.py")
    )
    assert robocentric < mine < dead_reckoning


def test_a_real_drive_is_solved_and_compared(shared_data: Path) -> None:
    reference = shared_data / "ground_truth" / "0020.tum"
    text = run(EXAMPLES / "solve_a_drive.py", shared_data / "0020.npz", reference)
    assert "0020: 1104 frames" in text
    assert len(numbers(r"ATE ([\d.]+) m", text)) == 3


def test_an_estimator_of_your_own_solves_a_real_drive_by_its_name_on_the_command_line(
    shared_data: Path, tmp_path: Path
) -> None:
    solve = ("-m", "vislam_ros.cli.main", "solve", shared_data / "0020.npz", "--out", "results")
    run(*solve, "--estimator", "my_estimator:MyEstimator")
    results = read_results(tmp_path / "results")
    assert results.summary["complete"]
    assert len(results.trajectory) == 1104
    assert np.all(np.isfinite(results.trajectory.positions))
    assert results.steps["used"].sum() > 1000
    assert results.parameters["slam_node"]["pixel_std"] == 1.0
    errors = vi.evaluate(results.trajectory, shared_data / "ground_truth" / "0020.tum")
    assert errors.ate.rmse < 20


def test_the_snippets_of_the_page_run_one_after_the_other(tmp_path: Path) -> None:
    page = (DOCS / "python.md").read_text()
    files = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", page, flags=re.DOTALL)
    for name, text in files:
        (tmp_path / name).write_text(text)
    assert main(["simulate", "drive.npz", "--steps", "60", "--landmarks", "300"]) == 0
    snippets = re.findall(r"```python\n(?!# \w+\.py)(.*?)```", page, flags=re.DOTALL)
    assert len(snippets) > 3
    (tmp_path / "page.py").write_text("\n".join(snippets))
    run("page.py")
