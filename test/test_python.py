# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The package from Python: its names, each imported when asked for."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vislam_ros as vi
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.trajectory import write_tum

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


def test_paths_do_where_drives_and_trajectories_do(tmp_path: Path) -> None:
    simulated = vi.simulate(steps=30, landmarks=150)
    write_simulated(tmp_path / "drive.npz", simulated)
    assert simulated.drive.ground_truth is not None
    write_tum(tmp_path / "truth.tum", simulated.drive.ground_truth)
    for path in (tmp_path / "drive.npz", str(tmp_path / "drive.npz")):
        np.testing.assert_array_equal(
            vi.solve(path).trajectory.positions, vi.solve(simulated.drive).trajectory.positions
        )
    along = vi.simulate(steps=20, landmarks=60, along=str(tmp_path / "truth.tum")).drive
    assert along.feature_stamps.tolist() == simulated.drive.feature_stamps[:20].tolist()


API: Any = vi  # who calls it looks at no types
SIMULATED: Any = vi.simulate(steps=5, landmarks=20)
DRIVE = SIMULATED.drive
FRAME: dict[str, Any] = {
    "stamps": [0.0],
    "ids": [[7]],
    "pixels": [[[650, 200, 640, 200]]],
    "twists": np.zeros((1, 6)),
    "camera": DRIVE.camera,
}
WRONG: dict[str, tuple[Callable[..., Any], str]] = {
    "solve of a simulation": (lambda: API.solve(SIMULATED), "drive is of type SimulatedDrive"),
    "solve of a list": (lambda: API.solve([DRIVE]), "drive is of type list"),
    "settings": (lambda: API.solve(DRIVE, "joint"), 'or each by name, as estimator="joint"'),
    "prediction settings": (
        lambda: API.solve(DRIVE, None, {"time_jump": 2.0}),
        "prediction_settings is of type dict: give PredictionSettings",
    ),
    "a map's file": (lambda: API.solve(DRIVE, given_map="map.npz"), "given_map is of type str"),
    "positions": (
        lambda: API.evaluate(DRIVE.ground_truth.positions, DRIVE.ground_truth),
        "estimate is of type ndarray: give a Trajectory",
    ),
    "no reference": (
        lambda: API.evaluate(DRIVE.ground_truth, None),
        "reference is of type NoneType: give a Trajectory",
    ),
    "a drive to load": (lambda: API.load_drive(DRIVE), "path is of type Drive: give the path"),
    "an open file": (lambda: API.read_tum(0), "path is of type int: give the path of a file"),
    "steps": (lambda: API.simulate(600), "settings is of type int: give each by name, as steps"),
    "along positions": (lambda: API.simulate(along=[1.0]), "along is of type list"),
    "a matrix": (lambda: API.Slam().set_camera(np.eye(3)), "camera is of type ndarray: give one"),
    "settings of a session": (lambda: API.Slam({"seed": 1}), "settings are of type dict"),
    "tracks' camera": (
        lambda: API.Drive.from_tracks(**{**FRAME, "camera": np.eye(3)}),
        "camera is of type ndarray: give one of StereoCamera.from_matrices",
    ),
    "tracks' ids": (
        lambda: API.Drive.from_tracks(**{**FRAME, "ids": 7}),
        "ids is of type int: give a list with an array for each frame",
    ),
    "tracks' pixels": (
        lambda: API.Drive.from_tracks(**{**FRAME, "pixels": [["many"]]}),
        "frame 0: pixels: are no array of numbers",
    ),
    "tracks' twists": (
        lambda: API.Drive.from_tracks(**{**FRAME, "twists": "none"}),
        "twists: are no array of numbers",
    ),
    "a format's name": (lambda: API.register_dataset("csv_tracks"), "has matches"),
    "an estimator's": (lambda: API.register_estimator("mine", "Mine", None), "no subclass"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_of_a_wrong_type_is_told_in_a_line_with_what_to_give(case: str) -> None:
    call, words = WRONG[case]
    with pytest.raises(vi.VislamError) as error:
        call()
    assert words in str(error.value)
    assert "\n" not in str(error.value)
