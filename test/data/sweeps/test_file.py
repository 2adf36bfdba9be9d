# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from vislam_ros.data.sweeps.file import SweepFile, read_sweep_file, swept_values
from vislam_ros.errors import VislamError


def read(tmp_path: Path, text: str) -> SweepFile:
    path = tmp_path / "sweep.yaml"
    path.write_text(text)
    return read_sweep_file(path)


def test_a_file_describes_a_sweep_with_paths_relative_to_it(tmp_path: Path) -> None:
    described = read(
        tmp_path,
        """
data: drives/one.npz
reference: /truth.tum
grid:
  slam_node.process_variance: [1e-10, 1e-9]
  slam_node.pixel_variance: [[1, 1, 1, 1], [9, 9, 9, 9]]
  slam_node.track_continuity: true
seeds: 3
""",
    )
    assert described.data == tmp_path / "drives" / "one.npz"
    assert str(described.reference) == "/truth.tum"
    assert described.params is None
    assert described.simulate is None
    assert described.seeds == (0, 1, 2)
    assert described.grid == {
        "slam_node.process_variance": (1e-10, 1e-9),
        "slam_node.pixel_variance": ((1, 1, 1, 1), (9, 9, 9, 9)),
        "slam_node.track_continuity": (True,),
    }


def test_an_empty_simulate_simulates_with_its_defaults(tmp_path: Path) -> None:
    described = read(tmp_path, "simulate:\nseeds: [7, 3, 7]\n")
    assert described.simulate == {}
    assert described.seeds == (7, 3)


def test_equal_values_are_swept_once() -> None:
    assert swept_values([9, 9.0, True, 1, [1, 2], [1, 2]]) == (9.0, True, 1, (1, 2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("grid: {", "not YAML"),
        ("- 1\n", "not a sweep"),
        ("gird: {}\n", "gird: no such key"),
        ("grid: [1]\n", r"grid: \[1\] is not a mapping"),
        ("data: 3\n", "data: 3 is not a path"),
        ("seeds: none\n", "seeds: 'none' is neither"),
        ("seeds: [1, -1]\n", "is neither"),
        ("seeds: true\n", "is neither"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VislamError, match=rf"sweep\.yaml.*: .*{message}"):
        read(tmp_path, text)
