# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories of other programs are read as what they are, and written as they want them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.data.trajectory import Trajectory, write_tum
from vislam_ros.data.trajectory_files import (
    FileFormat,
    of_camera,
    read_trajectory,
    write_trajectory,
)
from vislam_ros.errors import VislamError

START = 1_403_636_580_838_555_648


def random_trajectory(poses: int = 12) -> Trajectory:
    rng = np.random.default_rng(5)
    T = se3.exp(rng.normal(size=(poses, 6)))
    stamps = START + np.cumsum(rng.integers(1, 10**8, poses))
    return Trajectory.from_matrices(stamps, T)


def assert_equal(one: Trajectory, other: Trajectory) -> None:
    np.testing.assert_array_equal(one.stamps, other.stamps)
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_array_equal(one.quaternions, other.quaternions)


@pytest.mark.parametrize("file_format", ["tum", "euroc"])
def test_what_is_written_reads_back_to_the_last_bit(
    file_format: FileFormat, tmp_path: Path
) -> None:
    trajectory = random_trajectory()
    path = tmp_path / "out"
    assert write_trajectory(path, trajectory, file_format) == [path]
    assert_equal(read_trajectory(path), trajectory)


def test_eurocs_ground_truth_is_read(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text(
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], ...\r\n"
        "1403636580838555648, 4.6, -1.7, 0.8, 0.5, -0.1, -0.2, 0.8, -0.02, 0.03, 0.8, 0.1\r\n"
        "1403636580843555648,4.7,-1.8,0.9,0.6,-0.3,-0.4,0.7,-0.02,0.03,0.8,0.1,0,0\r\n"
    )
    trajectory = read_trajectory(path)
    assert trajectory.stamps.tolist() == [1403636580838555648, 1403636580843555648]
    assert trajectory.positions.tolist() == [[4.6, -1.7, 0.8], [4.7, -1.8, 0.9]]
    assert trajectory.quaternions.tolist() == [[-0.1, -0.2, 0.8, 0.5], [-0.3, -0.4, 0.7, 0.6]]


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("1403636580838555648", 1403636580838555648),
        ("1403636580838555648.0", 1403636580838555648),
        ("1.403636580838555648e+18", 1403636580838555648),
        ("9200000001", 9_200_000_001),
        ("9200000000", 9_200_000_000_000_000_000),
        ("1403636580.838555648", 1403636580838555648),
        ("0.1", 100_000_000),
    ],
)
def test_a_tum_file_tells_whether_it_is_in_seconds_or_nanoseconds(
    text: str, stamp: int, tmp_path: Path
) -> None:
    path = tmp_path / "a.tum"
    path.write_text(f"# a comment\n\n{text} 1 2 3 0 0 0 1\n")
    assert read_trajectory(path).stamps.tolist() == [stamp]


def test_a_header_without_its_mark_is_none_of_the_rows(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("timestamp,x,y,z,qw,qx,qy,qz\n5,1,2,3,1,0,0,0\n")
    assert read_trajectory(path).stamps.tolist() == [5]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no pose"),
        ("#timestamp [ns],x\n", "holds no pose"),
        ("5,1,2,3,1,0,0\n", "line 1 is '5,1,2,3,1,0,0': a row of EuRoC's csv holds eight numbers"),
        ("5,1,2,3,1,0,0,0\n6,1,,3,1,0,0,0\n", "line 2 is '6,1,,3"),
        ("5,1,2,3,1,0,0,0\n6 1 2 3 0 0 0 1\n", "line 2 is '6 1 2"),
        ("5,1,2,3,1,0,0,0\n5,1,2,3,1,0,0,0\n", "line 2 has stamp 0.000000005, not later"),
        ("5,1,2,3,nan,0,0,0\n", "line 1 is"),
        ("5,1,2,3,1,0,0,0\nx,1,2,3,1,0,0,0\n", "line 2 is"),
        ("1e400,1,2,3,1,0,0,0\n", "line 1 is"),
        ("1e999999999 1 2 3 0 0 0 1\n", "line 1 is"),
        ("-5,1,2,3,1,0,0,0\n", "line 1 is"),
        ("nan 1 2 3 0 0 0 1\n", "line 1 is"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", "line 1 holds twelve numbers: KITTI's poses have no times"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "bad"
    path.write_text(content)
    with pytest.raises(VislamError, match=message) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_kittis_poses_are_matrices_with_their_times_beside_them(tmp_path: Path) -> None:
    trajectory = random_trajectory()
    path = tmp_path / "03.txt"
    assert write_trajectory(path, trajectory, "kitti") == [path, tmp_path / "03_times.txt"]
    rows = np.loadtxt(path)
    np.testing.assert_array_equal(rows.reshape(-1, 3, 4), trajectory.T_world_body[:, :3])
    times = (tmp_path / "03_times.txt").read_text().split()
    assert [int(time.replace(".", "")) for time in times] == trajectory.stamps.tolist()


def test_files_are_not_replaced_unasked_and_none_is_made_then(tmp_path: Path) -> None:
    (tmp_path / "03_times.txt").write_text("mine\n")
    with pytest.raises(VislamError, match=r"03_times.txt: exists already.*--force"):
        write_trajectory(tmp_path / "03.txt", random_trajectory(), "kitti")
    assert [path.name for path in tmp_path.iterdir()] == ["03_times.txt"]
    write_trajectory(tmp_path / "03.txt", random_trajectory(), "kitti", force=True)
    assert (tmp_path / "03.txt").exists()


def test_a_cameras_poses_begin_at_the_identity_and_move_as_the_camera_does() -> None:
    trajectory = random_trajectory()
    T_body_camera = se3.exp([1.0, 0.2, -0.3, 1.2, -1.2, 1.2])
    camera = of_camera(trajectory, T_body_camera).T_world_body
    np.testing.assert_allclose(camera[0], np.eye(4), atol=1e-12)
    k = 7
    body = np.linalg.inv(trajectory.T_world_body[k - 1]) @ trajectory.T_world_body[k]
    expected = np.linalg.inv(T_body_camera) @ body @ T_body_camera
    np.testing.assert_allclose(np.linalg.inv(camera[k - 1]) @ camera[k], expected, atol=1e-12)


@pytest.mark.parametrize("first", ["1700000000.0", "0.0", "1.7e9"])
def test_a_tum_file_with_commas_is_told_to_have_blanks(tmp_path: Path, first: str) -> None:
    path = tmp_path / "t.tum"
    path.write_text(f"{first},1,2,3,0,0,0,1\n1700000000.1,1,2,3,0,0,0,1\n")
    with pytest.raises(VislamError, match=r"line 2 .* put blanks in place of the commas"):
        read_trajectory(path)


@pytest.mark.parametrize("stamps", [("0", "5"), ("1.7e18", "1.8e18"), ("17.0", "18.00")])
def test_whole_nanoseconds_may_be_written_in_any_way(
    tmp_path: Path, stamps: tuple[str, str]
) -> None:
    path = tmp_path / "data.csv"
    path.write_text("".join(f"{stamp},1,2,3,1,0,0,0\n" for stamp in stamps))
    assert read_trajectory(path).stamps.tolist() == [int(float(stamp)) for stamp in stamps]


@pytest.mark.parametrize("file_format", ["euroc", "kitti"])
def test_evo_reads_what_is_written(file_format: FileFormat, tmp_path: Path) -> None:
    program = Path(sys.executable).parent / "evo_traj"
    if not program.is_file():
        pytest.skip("needs evo_traj to read with: pip install evo")
    trajectory = random_trajectory()
    write_trajectory(tmp_path / "written.txt", trajectory, file_format)
    write_tum(tmp_path / "plain.tum", trajectory)
    save = "--save_as_tum" if file_format == "euroc" else "--save_as_kitti"
    subprocess.run(
        [program, file_format, tmp_path / "written.txt", save, "--no_warnings", "--silent"],
        cwd=tmp_path,
        env={"HOME": str(tmp_path), "PATH": ""},
        check=True,
        timeout=100,
    )
    if file_format == "euroc":
        theirs = np.loadtxt(tmp_path / "written.tum")
        np.testing.assert_allclose(theirs, np.loadtxt(tmp_path / "plain.tum"), rtol=1e-12)
    else:
        theirs = np.loadtxt(tmp_path / "written.kitti").reshape(-1, 3, 4)
        np.testing.assert_allclose(theirs, trajectory.T_world_body[:, :3], atol=1e-12)
