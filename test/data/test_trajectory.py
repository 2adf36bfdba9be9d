# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vislam_ros.core.geometry import se3
from vislam_ros.data.trajectory import (
    Trajectory,
    read_tum,
    stamp_from_text,
    stamp_text,
    tum_line,
    write_tum,
)
from vislam_ros.errors import VislamError


def random_trajectory(poses: int = 20) -> Trajectory:
    rng = np.random.default_rng(1)
    stamps = 1317386425_562502001 + np.cumsum(rng.integers(1, 10**9, poses))
    T = se3.exp(rng.normal(size=(poses, 6)) * [1e5, 1.0, 1e-7, 1.0, 1.0, 1.0])
    return Trajectory.from_matrices(stamps, T)


@given(st.integers(0, 2**62))
def test_a_stamp_reads_back_exactly(stamp: int) -> None:
    assert stamp_from_text(stamp_text(stamp)) == stamp


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("5", 5_000_000_000),
        ("5.", 5_000_000_000),
        ("1.5", 1_500_000_000),
        ("0.000000001", 1),
        ("1.0000000019", 1_000_000_001),
        ("1e1", 10_000_000_000),
        ("-0.5", -500_000_000),
    ],
)
def test_stamps_of_other_writers_are_understood(text: str, stamp: int) -> None:
    assert stamp_from_text(text) == stamp


def test_a_trajectory_reads_back_to_the_last_bit(tmp_path: Path) -> None:
    trajectory = random_trajectory()
    write_tum(tmp_path / "a.tum", trajectory)
    back = read_tum(tmp_path / "a.tum")
    np.testing.assert_array_equal(back.stamps, trajectory.stamps)
    np.testing.assert_array_equal(back.positions, trajectory.positions)
    np.testing.assert_array_equal(back.quaternions, trajectory.quaternions)


def test_a_line_has_exactly_eight_columns_and_no_type_names() -> None:
    line = tum_line(1_000_000_002, np.array([0.1, 2.0, -3e-9]), np.array([0.0, 0.0, 0.0, 1.0]))
    assert line == "1.000000002 0.1 2.0 -3e-09 0.0 0.0 0.0 1.0"


def test_poses_survive_the_way_to_matrices_and_back() -> None:
    trajectory = random_trajectory()
    back = Trajectory.from_matrices(trajectory.stamps, trajectory.T_world_body)
    np.testing.assert_allclose(back.positions, trajectory.positions, rtol=0, atol=0)
    np.testing.assert_allclose(back.quaternions, trajectory.quaternions, atol=1e-15)
    assert len(back) == 20


def test_comments_and_empty_lines_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("# t x y z qx qy qz qw\n\n1.0 1 2 3 0 0 0 1\n  \n2.0 1 2 3 0 0 0 1\n")
    assert read_tum(path).stamps.tolist() == [1_000_000_000, 2_000_000_000]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no pose"),
        ("1.0 1 2 3 0 0 0\n", "line 1 is '1.0 1 2 3 0 0 0': .* eight finite numbers"),
        ("1.0 1 2 3 0 0 0 1\n2.0 a 2 3 0 0 0 1\n", "line 2"),
        ("1.0 nan 2 3 0 0 0 1\n", "line 1"),
        ("1.0 1 2 3 0 0 0 0\n", "line 1"),
        ("inf 1 2 3 0 0 0 1\n", "line 1"),
        ("2.0 1 2 3 0 0 0 1\n2.0 1 2 3 0 0 0 1\n", "line 2 has stamp 2.0, .* leave one of"),
        ("2.0 1 2 3 0 0 0 1\n1.0 1 2 3 0 0 0 1\n", "line 2 has stamp 1.0, .* sort the file"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(content)
    with pytest.raises(VislamError, match=message) as caught:
        read_tum(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="No such file"):
        read_tum(tmp_path / "none.tum")
    (tmp_path / "binary.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VislamError, match="not a text file"):
        read_tum(tmp_path / "binary.tum")
