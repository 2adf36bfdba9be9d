# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
from step_rows import step_row

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.pictures.results import draw_steps, draw_trajectory, plot_results
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.data.results.writer import ResultWriter
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

POSES = 60


@pytest.fixture
def drive() -> Trajectory:
    """A round of 20 m radius."""
    step = se3.exp([2.0, 0.0, 0.02, 0.0, 0.0, 0.1])
    T = [np.eye(4)]
    for _ in range(POSES - 1):
        T.append(T[-1] @ step)
    return Trajectory.from_matrices(10**8 * np.arange(1, POSES + 1), np.array(T))


@pytest.fixture
def results(drive: Trajectory, tmp_path: Path) -> Results:
    with ResultWriter(tmp_path / "results") as writer:
        writer.summary.drive = "round"
        for k, stamp in enumerate(drive.stamps.tolist()):
            pose = (drive.positions[k], drive.quaternions[k])
            dof = 0 if k % 9 == 0 else 90
            counts = {"active": 40, "used": dof // 3, "rejected": k % 3, "observed": 45}
            nis = {"nis": float(dof), "nis_dof": dof}
            row = step_row(stamp, frozen=dof == 0, ms=1.5, **counts, **nis)
            writer.add_step(*pose, np.eye(6), row)
            writer.add_dead_reckoning(stamp, pose[0] * 1.1, pose[1])
        points = np.array([[0.0, 5.0, 0.0], [10.0, 20.0, 1.0], [1e6, 0.0, 0.0]])
        count = np.arange(3, dtype=np.uint32)
        writer.set_landmarks(LandmarkMap(count, count * 0, points, np.zeros((3, 3, 3))))
        writer.finish(complete=True)
    return read_results(writer.directory)


def lines(axes: object) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}  # type: ignore[attr-defined]


def test_the_picture_from_above_shows_what_there_is(results: Results, drive: Trajectory) -> None:
    moved = Trajectory.from_matrices(
        drive.stamps, se3.exp([50.0, 0.0, 0.0, 0.0, 0.0, 2.0]) @ drive.T_world_body
    )
    figure = draw_trajectory(results, moved)
    (axes,) = figure.axes
    drawn = lines(axes)
    assert set(drawn) == {
        "estimate",
        "dead reckoning",
        "reference",
        "landmarks (3)",
        "start",
        "end",
    }
    np.testing.assert_array_equal(drawn["estimate"], drive.positions[:, :2])
    np.testing.assert_allclose(drawn["reference"], drive.positions[:, :2], atol=1e-9)
    np.testing.assert_array_equal(drawn["start"], drive.positions[:1, :2])
    np.testing.assert_array_equal(drawn["end"], drive.positions[-1:, :2])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    title = axes.get_title()
    assert "round" in title
    assert "ATE 0.00 m" in title


def test_a_far_landmark_does_not_shrink_the_picture(results: Results) -> None:
    (axes,) = draw_trajectory(results).axes
    assert max(np.abs([*axes.get_xlim(), *axes.get_ylim()])) < 100.0
    assert len(lines(axes)["landmarks (3)"]) == 2


def test_the_steps_are_drawn_without_frozen_ones_in_the_nis(results: Results) -> None:
    figure = draw_steps(results)
    nis = lines(figure.axes[2])
    assert len(nis["each step"]) == np.count_nonzero(results.steps["nis_dof"])
    assert "mean 1.00" in nis


def test_pictures_are_written_and_not_overwritten(results: Results, drive: Trajectory) -> None:
    pictures = plot_results(results, drive)
    assert [path.name for path in pictures] == ["trajectory.png", "steps.png"]
    for path in pictures:
        assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(VislamError, match=r"trajectory.png: exists already"):
        plot_results(results)
    assert plot_results(results, force=True) == pictures


def test_a_run_without_steps_or_motion_has_its_picture(tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        pose = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        writer.add_step(*pose, np.zeros((6, 6)), step_row(10**9))
        writer.finish(complete=True)
    (writer.directory / "steps.csv").unlink()
    (picture,) = plot_results(read_results(writer.directory), output=tmp_path / "pictures")
    assert picture == tmp_path / "pictures" / "trajectory.png"
    assert picture.is_file()
