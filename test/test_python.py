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


def test_what_holds_arrays_is_shown_in_a_line() -> None:
    simulated = vi.simulate(steps=30, landmarks=150)
    drive = simulated.drive
    steps: list[object] = []
    predictions: list[object] = []
    solution = vi.solve(drive, smooth=True, on_step=steps.append, on_prediction=predictions.append)
    shown = (simulated, simulated.landmarks, drive, drive.ground_truth, solution)
    parts = (solution.trajectory, solution.smoothed, solution.landmarks, steps[-1])
    for each in (*shown, *parts, predictions[-1]):
        assert len(repr(each)) < 200
        assert "\n" not in repr(each)
        assert "array" not in repr(each)
    assert repr(drive).startswith("<Drive 'simulated': 30 frames, ")
    assert "2.9 s, " in repr(drive)
    assert repr(solution).startswith("<Solution of 'simulated' by robocentric: 30 poses, 2.9 s, ")
    assert repr(solution).endswith("; verdict good>")
    assert repr(solution.trajectory).endswith(" m, with covariances>")


def test_the_first_lines_of_the_documentation_run() -> None:
    drive = vi.simulate(steps=30, landmarks=150).drive
    solution = vi.solve(drive, smooth=True)
    assert drive.ground_truth is not None
    assert solution.smoothed is not None
    evaluation = vi.evaluate(solution.trajectory, drive.ground_truth)
    assert evaluation.ate.rmse < 0.3
    assert vi.evaluate(solution.smoothed, drive.ground_truth).nees_per_dof is not None
