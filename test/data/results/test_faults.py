# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Each file of a result directory is held against the others."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from vislam_ros.cli.main import main
from vislam_ros.data.results.faults import result_faults

STEPS = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a drive leaves, smoothed."""
    folder = tmp_path_factory.mktemp("whole")
    drive = str(folder / "drive.npz")
    assert main(["simulate", drive, "--steps", str(STEPS), "--landmarks", "150"]) == 0
    assert main(["solve", drive, "--out", str(folder / "results"), "--smooth"]) == 0
    assert result_faults(folder / "results") == []
    return folder / "results"


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def halved(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def scrambled(path: Path) -> None:
    path.write_bytes(bytes(range(128, 256)))


@pytest.mark.parametrize("damage", [emptied, halved, scrambled, Path.unlink])
@pytest.mark.parametrize(
    "name",
    [
        "trajectory.tum",
        "trajectory_covariance.csv",
        "dead_reckoning.tum",
        "smoothed.tum",
        "smoothed_covariance.csv",
        "steps.csv",
        "landmarks.npz",
        "landmarks.ply",
        "summary.json",
    ],
)
def test_a_damaged_file_is_named(
    name: str, damage: Callable[[Path], None], whole: Path, tmp_path: Path
) -> None:
    broken = shutil.copytree(whole, tmp_path / "broken")
    damage(broken / name)
    assert any(name in fault for fault in result_faults(broken))


def test_a_missing_row_is_counted(whole: Path, tmp_path: Path) -> None:
    broken = shutil.copytree(whole, tmp_path / "broken")
    table = broken / "trajectory_covariance.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    (fault,) = result_faults(broken)
    assert fault == f"{table.name} holds the covariances of {STEPS - 1} of {STEPS} poses"


def test_the_prediction_reaches_from_the_first_pose_to_the_last(
    whole: Path, tmp_path: Path
) -> None:
    for lines in (slice(1, None), slice(0, -1)):
        broken = shutil.copytree(whole, tmp_path / str(lines.start))
        poses = broken / "dead_reckoning.tum"
        poses.write_text("".join(poses.read_text().splitlines(keepends=True)[lines]))
        (fault,) = result_faults(broken)
        assert fault.startswith("dead_reckoning.tum goes from ")


def test_parameters_that_changed_are_counted(whole: Path, tmp_path: Path) -> None:
    broken = shutil.copytree(whole, tmp_path / "broken")
    summary = json.loads((broken / "summary.json").read_text())
    (broken / "summary.json").write_text(json.dumps({**summary, "parameter_changes": 2}))
    (fault,) = result_faults(broken)
    assert fault == "parameter_changes.csv holds 0 changes, summary.json says 2"


def test_a_recording_that_is_cut_is_a_fault(whole: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    assert main(["convert", str(whole.parent / "drive.npz"), str(bag)]) == 0
    results = shutil.copytree(whole, tmp_path / "results")
    shutil.copy(next(bag.glob("*.mcap")), results / "results.mcap")
    assert result_faults(results) == []
    halved(results / "results.mcap")
    (fault,) = result_faults(results)
    assert fault.startswith("results.mcap: ")
