# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images are tracked, and solved by way of their tracks or straight, to the same bytes."""

from pathlib import Path

import numpy as np
import pytest
from imagery.bags import OURS, REALSENSE, drive_messages, write_messages
from imagery.folders import FRAMES, write_asl, write_dataset, write_kitti_odometry

from vislam_ros.cli.main import main
from vislam_ros.data.datasets.formats import read_dataset

FILES = ("trajectory.tum", "dead_reckoning.tum", "trajectory_covariance.csv", "landmarks.npz")


@pytest.fixture
def kitti(tmp_path: Path) -> tuple[Path, Path]:
    """Images, and the dataset that has their motion."""
    return write_kitti_odometry(tmp_path / "06"), write_dataset(tmp_path / "motion.npz")


def test_tracks_solve_as_their_images_do(
    kitti: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, motion = map(str, kitti)
    tracks = tmp_path / "tracks.npz"
    assert main(["track", images, str(tracks), "--motion", motion]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{tracks}: {FRAMES} feature frames, ")
    assert "note: " in err
    by_tracks, straight = tmp_path / "by_tracks", tmp_path / "straight"
    assert main(["solve", str(tracks), "--out", str(by_tracks)]) == 0
    assert main(["solve", images, "--motion", motion, "--out", str(straight)]) == 0
    for name in FILES:
        assert (by_tracks / name).read_bytes() == (straight / name).read_bytes()
    # To the right, against the body's y axis.
    way = np.loadtxt(by_tracks / "trajectory.tum")[-1, 1:4]
    assert np.linalg.norm(way - [0.0, -0.04 * (FRAMES - 1), 0.0]) < 0.02


def test_images_become_a_bag_that_solves_as_they_do(
    kitti: tuple[Path, Path], tmp_path: Path
) -> None:
    images, motion = map(str, kitti)
    bag, by_bag, straight = (tmp_path / name for name in ("bag", "by_bag", "straight"))
    assert main(["convert", images, str(bag), "--motion", motion]) == 0
    assert main(["solve", str(bag), "--out", str(by_bag)]) == 0
    assert main(["solve", images, "--motion", motion, "--out", str(straight)]) == 0
    for name in FILES:
        assert (by_bag / name).read_bytes() == (straight / name).read_bytes()


def test_a_folder_with_its_own_motion_needs_nothing_else(tmp_path: Path) -> None:
    tracks = tmp_path / "tracks.npz"
    assert main(["track", str(write_asl(tmp_path / "V1_01")), str(tracks)]) == 0
    drive = read_dataset(tracks)
    assert drive.name == "V1_01"
    assert np.all(np.isnan(drive.twists[:, :3]))
    assert drive.ground_truth is not None


@pytest.mark.parametrize("named", [False, True])
def test_a_bags_topics_are_found_or_named(named: bool, tmp_path: Path) -> None:
    if named:
        names = {role: f"/car/{role}" for role in OURS}
        rules = [
            f"stereo/left/image_raw:={names['left']}",
            f"stereo/right/image_raw:={names['right']}",
            f"stereo/left/camera_info:={names['left_info']}",
            f"stereo/right/camera_info:={names['right_info']}",
            f"imu/twist:={names['twist']}",
            f"stereo/extrinsics:={names['extrinsics']}",
        ]
        flags = ["--remap", *rules]
        bag = write_messages(tmp_path / "bag", drive_messages(names))
    else:
        flags = []
        bag = write_messages(tmp_path / "bag", drive_messages(REALSENSE))
    tracks = tmp_path / "tracks.npz"
    assert main(["track", str(bag), str(tracks), *flags]) == 0
    assert read_dataset(tracks).steps == FRAMES


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["{images}", "{there}"], "exists already: choose another output or add --force"),
        (["{images}", "{out}.bag"], "tracks are an .npz file"),
        (["{images}", "{out}"], "nothing tells the motion: give a dataset or a bag"),
        (["{motion}", "{out}"], "holds no images: give an EuRoC/ASL folder"),
        (["{images}", "{out}", "--motion", "{images}"], "neither a dataset nor a bag"),
        (["{images}", "{out}", "--remap", "imu/data:=/a"], "is no bag: leave out --remap"),
    ],
)
def test_mistakes_are_a_line_and_leave_nothing(
    words: list[str],
    reason: str,
    kitti: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    there = tmp_path / "there.npz"
    there.write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    places = {"images": kitti[0], "motion": kitti[1], "there": there, "out": tmp_path / "o.npz"}
    assert main(["track", *(word.format(**places) for word in words)]) == 1
    err = capsys.readouterr().err
    assert reason in err
    assert len(err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_real_images_make_a_better_trajectory_than_dead_reckoning(
    shared_images: Path, shared_data: Path, tmp_path: Path
) -> None:
    from vislam_ros.data.evaluation.evaluate import evaluate
    from vislam_ros.data.trajectory import read_tum

    results, motion = tmp_path / "results", shared_data / "0020.npz"
    images = shared_images / "kitti_0020"
    assert main(["solve", str(images), "--motion", str(motion), "--out", str(results)]) == 0
    truth = read_tum(shared_data / "ground_truth" / "0020.tum")
    with_images, without = (
        evaluate(read_tum(results / name), truth).ate.rmse
        for name in ("trajectory.tum", "dead_reckoning.tum")
    )
    assert with_images < without
