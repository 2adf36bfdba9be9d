# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images become a drive whose tracks, camera and motion are those of the images."""

from pathlib import Path

import numpy as np
import pytest
from imagery.bags import OURS, drive_messages, write_messages
from imagery.folders import (
    CAMERA,
    DISPARITY,
    PERIOD,
    SHIFT,
    SIZE,
    SPEED,
    STAMPS,
    write_asl,
    write_course,
    write_dataset,
    write_kitti_odometry,
)
from rewriting import assert_same

from vislam_ros.data.conversion import convert
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.pairing import pair_stamps
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.data.loading import load_drive
from vislam_ros.errors import VislamError


def test_tracks_move_as_the_wall_does(tmp_path: Path) -> None:
    shares: list[float] = []
    images = read_images(write_asl(tmp_path / "V1_01"))
    drive = tracked_drive(images, progress=shares.append)
    assert shares[-1] == 1.0
    assert (drive.name, drive.image_size) == ("V1_01", SIZE)
    np.testing.assert_array_equal(drive.feature_stamps, STAMPS)
    assert np.diff(drive.offsets).min() > 20
    ids_before, before = drive.frame(3)
    ids, pixels = drive.frame(4)
    _, rows_before, rows = np.intersect1d(ids_before, ids, return_indices=True)
    assert len(rows) > 15
    moved = pixels[rows, 0] - before[rows_before, 0]
    assert np.median(np.abs(moved + SHIFT)) < 0.05
    assert np.median(np.abs(drive.pixels[:, 0] - drive.pixels[:, 2] - DISPARITY)) < 0.05
    assert drive.noise.shape == drive.ids.shape
    assert np.all(drive.noise > 0)


def test_the_camera_is_that_of_the_rig(tmp_path: Path) -> None:
    drive = tracked_drive(read_images(write_asl(tmp_path / "V1_01")))
    camera = drive.camera
    assert (camera.fx, camera.cx, camera.cy) == (CAMERA.fx, CAMERA.cx, CAMERA.cy)
    assert camera.baseline == pytest.approx(CAMERA.baseline)
    np.testing.assert_allclose(camera.T_body_camera, CAMERA.T_body_camera, atol=1e-12)


def test_every_source_of_the_same_images_gives_the_same_tracks(tmp_path: Path) -> None:
    motion = write_dataset(tmp_path / "motion.npz")
    sources = (
        write_asl(tmp_path / "V1_01"),
        write_kitti_odometry(tmp_path / "06"),
        write_course(tmp_path / "course"),
        write_messages(tmp_path / "bag", drive_messages(OURS)),
    )
    first, *others = (load_drive(source, motion=motion) for source in sources)
    for other in others:
        assert_same(other.ids, first.ids)
        assert_same(other.pixels, first.pixels)
        assert_same(other.feature_stamps, first.feature_stamps)
        assert_same(other.twists, first.twists)


def test_the_motion_is_that_of_the_time_of_the_images(tmp_path: Path) -> None:
    images = read_images(write_asl(tmp_path / "V1_01"))
    drive = tracked_drive(images)
    assert images.motion.stamps[0] < STAMPS[0] - PERIOD // 2
    assert drive.twist_stamps[0] == STAMPS[0]
    assert drive.twist_stamps[-1] == STAMPS[-1]


def test_images_without_motion_or_times_are_refused(tmp_path: Path) -> None:
    folder = write_kitti_odometry(tmp_path / "06")
    with pytest.raises(VislamError, match="06: nothing tells the motion: give a dataset or a bag"):
        load_drive(folder)


def test_a_motion_that_was_refused_as_a_whole_is_told(tmp_path: Path) -> None:
    names = {role: name for role, name in OURS.items() if role != "twist"} | {"imu": "/imu/data"}
    bag = write_messages(tmp_path / "bag", drive_messages(names))
    with pytest.raises(VislamError, match=r"Skipped 8 messages of /imu/data: .*'imu_frame'"):
        load_drive(bag)


def test_motion_for_what_holds_no_images_is_refused(tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "drive.npz")
    with pytest.raises(VislamError, match=r"drive\.npz: holds no images: leave out --motion"):
        load_drive(data, motion=data)


def test_tracks_tell_what_twists_of_a_dataset_without_features_mean(tmp_path: Path) -> None:
    images = write_course(tmp_path / "course")
    data = images.with_name("dataset00.npz")
    arrays = dict(np.load(data))
    del arrays["features"]
    # Forward, right and down; the extrinsics are forward, left and up.
    arrays["linear_velocity"] = -arrays["linear_velocity"]
    np.savez(data, **arrays)
    drive = load_drive(images)
    # What is played live says the same.
    convert(images, tmp_path / "bag")
    np.testing.assert_array_equal(load_drive(tmp_path / "bag").twists, drive.twists)
    assert not any("dead reckoning" in note for note in drive.notes)
    assert any("forward-right-down" in note.split("(others")[0] for note in drive.notes)
    # Turned to forward, left and up.
    np.testing.assert_allclose(drive.twists[:, 1], -SPEED)
    np.testing.assert_allclose(drive.camera.T_body_camera, CAMERA.T_body_camera, atol=1e-9)


def test_stamps_are_paired_with_their_nearest_within_the_tolerance() -> None:
    first = np.array([0, 100, 200, 300, 400])
    second = np.array([4, 151, 198, 305, 450, 500])
    pairs = pair_stamps(first, second, 50)
    np.testing.assert_array_equal(pairs.first, [0, 2, 3, 4])
    np.testing.assert_array_equal(pairs.second, [0, 2, 3, 4])
    assert len(pair_stamps(first, second[4:], 49).first) == 0
    assert len(pair_stamps(first, np.empty(0, dtype=np.int64), 49).first) == 0
