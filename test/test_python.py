# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The package from Python: its names, each imported when asked for."""

import subprocess
import sys

import pytest

import vislam_ros as vi

NAMES = {
    "load_drive",
    "Drive",
    "solve",
    "Solution",
    "Slam",
    "SlamSettings",
    "PredictionSettings",
    "simulate",
    "evaluate",
    "read_tum",
    "register_estimator",
    "register_dataset",
    "VislamError",
}


def test_these_names_are_all_there_is() -> None:
    assert set(vi.__all__) == NAMES
    assert set(dir(vi)) >= NAMES
    for name in NAMES:
        assert getattr(vi, name).__doc__
        assert getattr(vi, name).__module__.startswith("vislam_ros.")
    with pytest.raises(AttributeError, match="no attribute 'load_drives'"):
        vi.load_drives  # noqa: B018


def test_importing_the_package_imports_nothing_large() -> None:
    program = "import sys, vislam_ros; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    loaded = set(result.stdout.split())
    assert "vislam_ros" in loaded
    assert not loaded & {"numpy", "scipy", "numba", "matplotlib", "rosbags", "rclpy"}


def test_the_first_lines_of_the_documentation_run() -> None:
    drive = vi.simulate(steps=30, landmarks=150).drive
    solution = vi.solve(drive, smooth=True)
    assert drive.ground_truth is not None
    assert solution.smoothed is not None
    evaluation = vi.evaluate(solution.trajectory, drive.ground_truth)
    assert evaluation.ate.rmse < 0.3
    assert vi.evaluate(solution.smoothed, drive.ground_truth).nees_per_dof is not None
