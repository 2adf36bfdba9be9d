# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's figures from one command."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import REPOSITORY
from report.experiments import ExperimentResult
from report.figures import FIGURES, draw_figure

from vislam_ros.data.trajectory import Trajectory

TOOL = REPOSITORY / "tools" / "reproduce_report.py"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    result = subprocess.run(
        [sys.executable, TOOL, "--steps", "40", "--out", folder, "--jobs", "2"],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert result.returncode == 0, result.stderr
    return folder


def test_one_command_draws_every_figure(report: Path) -> None:
    assert {f"figure_{k}" for k in range(2, 7)} < set(FIGURES)
    for name in FIGURES:
        assert (report / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_larger_v_brings_the_path_to_dead_reckoning(report: Path) -> None:
    numbers = json.loads((report / "report.json").read_text())["experiments"]
    apart = [
        numbers[name]["from_dead_reckoning_m"]
        for name in ("v_0.01", "v_1", "table_i_33", "v_10000")
    ]
    assert apart[0] > apart[1] > max(apart[2:])
    assert (
        numbers["w_1e-8"]["from_dead_reckoning_m"] > numbers["table_i_33"]["from_dead_reckoning_m"]
    )
    assert all(experiment["ate_m"] is not None for experiment in numbers.values())


def test_an_experiment_that_diverged_is_drawn_and_said_so() -> None:
    stamps = np.arange(20, dtype=np.int64) * 100_000_000
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))
    straight = np.stack([np.arange(20.0), np.zeros(20), np.zeros(20)], axis=1)
    away = straight * [1.0, 0.0, 0.0] ** np.arange(20)[:, None]
    away[:, 1] = 10.0 ** np.arange(20)
    away[15:] = np.nan
    result = ExperimentResult(
        Trajectory(stamps, away, quaternions),
        Trajectory(stamps, straight, quaternions),
        np.array([[5.0, 3.0, 0.0], [np.nan, 0.0, 0.0]]),
    )
    (axes,) = draw_figure(FIGURES["figure_3"], {"table_i_33": result}, None, "a drive").axes
    assert "diverged: 15 of 20 poses are finite" in axes.get_title()
    assert axes.get_ylim()[1] < 100
