# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every format gives the same pairs, the same rig and the motion as it is recorded."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imagery import folders
from imagery.folders import (
    FRAMES,
    PERIOD,
    SIZE,
    SPEED,
    STAMPS,
    T_BODY_LEFT,
    T_LEFT_RIGHT,
    K,
    pair,
    write_asl,
    write_course,
    write_dataset,
    write_kitti_odometry,
    write_kitti_raw,
)

from vislam_ros.data.image_sources import is_images, read_images
from vislam_ros.data.images.folders import asl, kitti_odometry, kitti_raw
from vislam_ros.data.images.stereo_images import StereoImages

OMEGA = (0.001, -0.002, 0.003)


def kitti_with_motion(folder: Path) -> StereoImages:
    images = write_kitti_odometry(folder / "06")
    return read_images(images, write_dataset(folder / "motion.npz"))


READ: dict[str, Callable[[Path], StereoImages]] = {
    "asl": lambda folder: read_images(write_asl(folder / "V1_01")),
    "mav0": lambda folder: read_images(write_asl(folder / "V1_01") / "mav0"),
    "kitti odometry": kitti_with_motion,
    "kitti raw": lambda folder: read_images(write_kitti_raw(folder / "0020_sync")),
    "course": lambda folder: read_images(write_course(folder / "course")),
    "course's dataset": lambda folder: read_images(
        write_course(folder / "course").with_name("dataset00.npz")
    ),
}


@pytest.mark.parametrize("read", READ.values(), ids=READ)
def test_the_pairs_and_the_rig_are_those_that_were_written(
    read: Callable[[Path], StereoImages], tmp_path: Path
) -> None:
    images = read(tmp_path)
    pairs = list(images.pairs())
    assert len(images) == len(pairs) == FRAMES
    np.testing.assert_allclose(images.stamps, STAMPS, atol=200, rtol=0)
    for k, (stamp, left, right) in enumerate(pairs):
        assert stamp == images.stamps[k]
        assert left.encoding == right.encoding == "mono8"
        np.testing.assert_array_equal(left.pixels, pair(k)[0])
        np.testing.assert_array_equal(right.pixels, pair(k)[1])
    for camera in (images.rig.left, images.rig.right):
        assert camera.image_size == SIZE
        np.testing.assert_allclose(camera.K, K)
    np.testing.assert_allclose(images.rig.T_left_right, T_LEFT_RIGHT, atol=1e-12)
    np.testing.assert_allclose(images.rig.T_body_left, T_BODY_LEFT, atol=1e-9)
    assert images.timed


@pytest.mark.parametrize("read", READ.values(), ids=READ)
def test_the_motion_reaches_over_the_images(
    read: Callable[[Path], StereoImages], tmp_path: Path
) -> None:
    motion = read(tmp_path).motion
    assert motion is not None
    assert np.all(np.diff(motion.stamps) > 0)
    assert motion.twists.shape == (len(motion.stamps), 6)
    assert motion.stamps[0] <= STAMPS[0] + PERIOD
    assert motion.stamps[-1] >= STAMPS[-1] - 200


def test_an_imu_tells_turns_and_accelerations_and_no_velocity(tmp_path: Path) -> None:
    images = asl.read(write_asl(tmp_path / "V1_01"))
    assert images.name == "V1_01"
    motion = images.motion
    assert np.all(np.isnan(motion.twists[:, :3]))
    np.testing.assert_allclose(motion.twists[:, 3:], np.tile(OMEGA, (len(motion.stamps), 1)))
    np.testing.assert_allclose(motion.accelerations[3], [0.0, 0.0, 9.81])


def test_the_body_is_the_imu_where_it_is_not_the_frame_of_the_file(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    T_file_imu = np.array(
        [[0.0, 1.0, 0.0, 0.3], [-1.0, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]]
    )
    text = f"%YAML:1.0\nT_BS: {folders.matrix_text(T_file_imu)}\n"
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(text)
    images = asl.read(folder)
    np.testing.assert_allclose(T_file_imu @ images.rig.T_body_left, T_BODY_LEFT, atol=1e-12)
    np.testing.assert_allclose(images.motion.twists[0, 3:], OMEGA)
    truth = images.ground_truth
    # Against the y axis of the file is along the x axis of the IMU.
    np.testing.assert_allclose(truth.positions[1], [SPEED * 0.1, 0.0, 0.0], atol=1e-9)


def test_references_begin_at_the_first_frame(tmp_path: Path) -> None:
    truth = asl.read(write_asl(tmp_path / "V1_01")).ground_truth
    np.testing.assert_array_equal(truth.stamps, STAMPS)
    np.testing.assert_allclose(truth.positions[0], 0.0)
    np.testing.assert_allclose(truth.positions[-1], [0.0, -SPEED * 0.7, 0.0], atol=1e-9)


def test_the_reference_of_a_camera_becomes_that_of_the_body(tmp_path: Path) -> None:
    folder = write_kitti_odometry(tmp_path / "06")
    alone = kitti_odometry.read(folder).ground_truth
    np.testing.assert_allclose(alone.positions[-1], [SPEED * 0.7, 0.0, 0.0], atol=1e-9)
    moved = read_images(folder, write_dataset(tmp_path / "motion.npz")).ground_truth
    np.testing.assert_allclose(moved.positions[-1], [0.0, -SPEED * 0.7, 0.0], atol=1e-9)


def test_velocities_of_oxts_are_turned_from_level_into_the_units_axes(tmp_path: Path) -> None:
    images = kitti_raw.read(write_kitti_raw(tmp_path / "0020_sync"))
    c, s = np.cos(-0.1), np.sin(-0.1)
    # The unit points up by 0.1 rad: what goes up with the slope goes forward.
    expected = [10.0 * c - 1.0 * s, -SPEED, 10.0 * s + 1.0 * c]
    np.testing.assert_allclose(images.motion.twists[0, :3], expected, atol=1e-12)
    np.testing.assert_allclose(images.motion.twists[0, 3:], OMEGA)
    truth = images.ground_truth
    # One millionth of a degree to the east, on the right of who heads north.
    way = np.radians(1e-6) * 6378137.0 * np.cos(np.radians(49.0))
    np.testing.assert_allclose(truth.positions[1], [0.0, -way, 0.0], atol=1e-9)


def test_images_of_a_raw_drive_that_are_not_rectified_are_known_by_their_size(
    tmp_path: Path,
) -> None:
    folder = write_kitti_raw(tmp_path / "0020_extract")
    width, height = SIZE
    rows = {f"S_{n}": f"{width} {height}" for n in ("00", "01")}
    rows |= {f"K_{n}": "101 0 79 0 102 59 0 0 1" for n in ("00", "01")}
    rows |= {f"D_{n}": "-0.3 0.2 0.001 0.002 -0.1" for n in ("00", "01")}
    rows |= {"R_00": "1 0 0 0 1 0 0 0 1", "T_00": "0 0 0"}
    rows |= {"R_01": "1 0 0 0 1 0 0 0 1", "T_01": "-0.1 0 0"}
    folders.write_lines(tmp_path / "calib_cam_to_cam.txt", rows)
    rig = kitti_raw.read(folder).rig
    assert rig.left.distortion_model == "plumb_bob"
    np.testing.assert_allclose(rig.right.D, [-0.3, 0.2, 0.001, 0.002, -0.1])
    np.testing.assert_allclose(rig.T_left_right, T_LEFT_RIGHT, atol=1e-12)
    np.testing.assert_allclose(rig.T_body_left, T_BODY_LEFT, atol=1e-12)


def test_a_wide_lens_and_a_chain_of_kalibr_are_read(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "room1")
    for name in ("cam0", "cam1"):
        (folder / "mav0" / name / "sensor.yaml").unlink()
    chain = folder / "dso" / "camchain.yaml"
    chain.parent.mkdir()
    text = ""
    for name, T in (("cam0", T_BODY_LEFT), ("cam1", T_BODY_LEFT @ T_LEFT_RIGHT)):
        text += (
            f"{name}:\n  T_cam_imu: {np.linalg.inv(T).tolist()}\n  camera_model: pinhole\n"
            "  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]\n  distortion_model: equidistant\n"
            f"  intrinsics: [{K[0, 0]}, {K[1, 1]}, {K[0, 2]}, {K[1, 2]}]\n"
        )
    chain.write_text(text)
    rig = asl.read(folder).rig
    assert (rig.left.distortion_model, rig.left.image_size) == ("equidistant", SIZE)
    np.testing.assert_allclose(rig.left.D, [0.01, 0.02, 0.03, 0.04])
    np.testing.assert_allclose(rig.T_body_left, T_BODY_LEFT, atol=1e-12)


def test_cameras_that_are_the_other_way_round_are_exchanged(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01") / "mav0"
    (folder / "cam0").rename(folder / "other")
    (folder / "cam1").rename(folder / "cam0")
    (folder / "other").rename(folder / "cam1")
    images = asl.read(folder)
    assert images.notes == ("cam1 lies to the left of cam0: taken as the left camera.",)
    np.testing.assert_array_equal(next(images.pairs()).left.pixels, pair(0)[0])
    np.testing.assert_allclose(images.rig.T_left_right, T_LEFT_RIGHT, atol=1e-12)


def test_what_is_no_folder_of_images_is_not_taken_for_one(tmp_path: Path) -> None:
    assert not is_images(tmp_path)
    assert not is_images(tmp_path / "missing")
    assert not is_images(write_dataset(tmp_path / "drive.npz"))
    assert is_images(write_course(tmp_path / "course"))


def test_real_folders_are_read(shared_images: Path, shared_data: Path) -> None:
    euroc = read_images(shared_images / "euroc_v101")
    assert (len(euroc), euroc.rig.left.image_size) == (30, (752, 480))
    assert euroc.rig.T_left_right[0, 3] == pytest.approx(0.11007, abs=1e-5)
    kitti = read_images(shared_images / "kitti_0020", shared_data / "0020.npz")
    assert (len(kitti), kitti.rig.left.image_size) == (51, (1226, 370))
    assert kitti.timed
    assert kitti.rig.T_left_right[0, 3] == pytest.approx(0.53715, abs=1e-4)
    for images in (euroc, kitti):
        assert sum(1 for _ in images.pairs()) == len(images)
        assert not images.notes or "stamps of the motion" in images.notes[0]
