# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags of images are read by their own names, by given ones, and by those that drivers use."""

import re
from pathlib import Path

import numpy as np
import pytest
from imagery.bags import (
    NEW,
    OURS,
    REALSENSE,
    camera_info,
    drive_messages,
    image_message,
    transform,
    write_messages,
)
from imagery.folders import (
    BASELINE,
    FOCAL,
    FRAMES,
    SIZE,
    SPEED,
    STAMPS,
    T_BODY_LEFT,
    T_LEFT_RIGHT,
    pair,
    write_dataset,
)

from vislam_ros.core.geometry import se3
from vislam_ros.data.image_sources import read_images, read_motion
from vislam_ros.data.images.bags import reader as bag
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.errors import VislamError


def assert_whole(images: StereoImages) -> None:
    """All pairs are there, with their rig."""
    np.testing.assert_array_equal(images.stamps, STAMPS)
    pairs = list(images.pairs())
    assert len(pairs) == FRAMES
    for k, (stamp, left, right) in enumerate(pairs):
        assert (stamp, left.encoding) == (STAMPS[k], "mono8")
        np.testing.assert_array_equal(left.pixels, pair(k)[0])
        np.testing.assert_array_equal(right.pixels, pair(k)[1])
    assert images.rig.left.image_size == images.rig.right.image_size == SIZE
    np.testing.assert_allclose(images.rig.T_left_right, T_LEFT_RIGHT, atol=1e-12)
    np.testing.assert_allclose(images.rig.T_body_left, T_BODY_LEFT, atol=1e-12)


@pytest.mark.parametrize("compressed", [False, True])
def test_the_topics_of_this_package_are_read(compressed: bool, tmp_path: Path) -> None:
    names = dict(OURS)
    if compressed:
        names |= {side: f"{names[side]}/compressed" for side in ("left", "right")}
    path = write_messages(tmp_path / "bag", drive_messages(names, compressed=compressed))
    assert bag.matches(path)
    images = read_images(path)
    assert_whole(images)
    assert images.notes == ()
    np.testing.assert_allclose(images.motion.twists[:, 1], -SPEED)


def test_topics_of_other_names_are_given(tmp_path: Path) -> None:
    ours = {"left": "stereo/left/image_raw", "right": "stereo/right/image_raw"}
    ours |= {"twist": "imu/twist"}
    names = OURS | {role: f"/car/{role}" for role in ours}
    path = write_messages(tmp_path / "bag", drive_messages(names))
    images = read_images(path, topics={name: f"/car/{role}" for role, name in ours.items()})
    assert_whole(images)
    assert images.notes == ()


def test_a_realsense_is_known_by_its_names_and_frames(tmp_path: Path) -> None:
    frame = "camera_infra1_optical_frame"
    path = write_messages(tmp_path / "bag", drive_messages(REALSENSE, frame=frame))
    images = read_images(path)
    assert_whole(images)
    assert images.notes == (
        "Took /camera/infra1/image_rect_raw and /camera/infra2/image_rect_raw for the images.",
        "Took /camera/gyro/sample for the IMU.",
    )
    assert np.all(np.isnan(images.motion.twists[:, :3]))
    np.testing.assert_allclose(images.motion.twists[0, 3:], (0.001, -0.002, 0.003))
    np.testing.assert_allclose(images.motion.accelerations[0], (0.0, 0.0, 9.81))


def test_twists_count_for_more_than_an_imu(tmp_path: Path) -> None:
    path = write_messages(tmp_path / "bag", drive_messages(OURS | {"imu": "/imu/data"}))
    np.testing.assert_allclose(read_images(path).motion.twists[:, 1], -SPEED)


def test_an_unrectified_pair_stands_as_both_camera_infos_say(tmp_path: Path) -> None:
    R_left, R_right = se3.exp_rotation([0.02, -0.01, 0.03]), se3.exp_rotation([-0.01, 0.02, 0.01])
    D = np.array([-0.2, 0.1, 0.001, 0.002, 0.0])
    messages = drive_messages({r: n for r, n in OURS.items() if "info" not in r})
    info = "sensor_msgs/msg/CameraInfo"
    first = int(STAMPS[0])
    left = camera_info("camera_left_optical", 0.0, R_left, D)
    right = camera_info("camera_left_optical", -FOCAL * BASELINE, R_right, D)
    messages[:0] = [
        (OURS["left_info"], info, first, left),
        (OURS["right_info"], info, first, right),
    ]
    rig = read_images(write_messages(tmp_path / "bag", messages)).rig
    np.testing.assert_allclose(rig.left.D, D)
    # A point in the right camera, by way of the rectified frames.
    point = np.array([0.3, -0.2, 4.0])
    rectified = R_right @ point + [BASELINE, 0.0, 0.0]
    found = rig.T_left_right[:3, :3] @ point + rig.T_left_right[:3, 3]
    np.testing.assert_allclose(R_left @ found, rectified, atol=1e-12)


def test_coefficients_that_nobody_asked_for_are_zeros_at_the_end(tmp_path: Path) -> None:
    D = np.array([-0.2, 0.1, 0.001, 0.002, 0.0, 0.01, 0.0, 0.0, *[0.0] * 6])
    messages = drive_messages(OURS)
    for topic, _, _, message in messages:
        if topic in (OURS["left_info"], OURS["right_info"]):
            message.d, message.distortion_model = D, "rational_polynomial"
    rig = read_images(write_messages(tmp_path / "bag", messages)).rig
    np.testing.assert_array_equal(rig.left.D, D[:8])


def test_lenses_with_more_coefficients_than_are_known_are_refused(tmp_path: Path) -> None:
    messages = drive_messages(OURS)
    for topic, _, _, message in messages:
        if topic == OURS["left_info"]:
            message.d = np.full(8, 0.01)
    path = write_messages(tmp_path / "bag", messages)
    with pytest.raises(VislamError, match="left camera: plumb_bob has 8 coefficients") as caught:
        read_images(path)
    assert str(path) in str(caught.value)


def test_images_without_a_partner_and_stamps_that_differ_are_noted(tmp_path: Path) -> None:
    messages = drive_messages(OURS)
    lost = [m for m in messages if not (m[0] == OURS["right"] and m[2] == STAMPS[3])]
    for topic, _, _, message in lost:
        if topic == OURS["right"]:
            message.header.stamp.nanosec += 2_000_000
    images = read_images(write_messages(tmp_path / "bag", lost))
    assert len(images) == sum(1 for _ in images.pairs()) == FRAMES - 1
    assert images.notes == (
        "Left out 1 images without one of the other camera at their stamp.",
        "The stamps of left and right differ by up to 2 ms: taken for the same moments.",
    )


def test_colours_padding_and_deep_greys_come_as_they_are(tmp_path: Path) -> None:
    colour = np.dstack([pair(0)[0]] * 3)
    colour[..., 1] //= 2
    deep = (pair(0)[1].astype(np.uint16) * 200).astype(">u2")
    messages = [m for m in drive_messages(OURS) if m[0] not in (OURS["left"], OURS["right"])]
    stamp, kind = int(STAMPS[0]), "sensor_msgs/msg/Image"
    left = image_message(stamp, "camera_left_optical", colour, "rgb8")
    left.step += 7
    left.data = np.pad(left.data.reshape(left.height, -1), ((0, 0), (0, 7))).ravel()
    right = image_message(stamp, "camera_left_optical", deep, "mono16")
    right.is_bigendian = 1
    messages += [(OURS["left"], kind, stamp, left), (OURS["right"], kind, stamp, right)]
    found = next(read_images(write_messages(tmp_path / "bag", messages)).pairs())
    assert (found.left.encoding, found.right.encoding) == ("rgb8", "mono16")
    np.testing.assert_array_equal(found.left.pixels, colour)
    np.testing.assert_array_equal(found.right.pixels, deep.astype(np.uint16))
    assert found.right.pixels.dtype == np.uint16


def test_motion_comes_from_a_bag_without_features(tmp_path: Path) -> None:
    motion_names = {"gyro": "/imu/data"}
    messages = [m for m in drive_messages({**OURS, **motion_names}) if m[0] == "/imu/data"]
    given = read_motion(write_messages(tmp_path / "motion", messages))
    np.testing.assert_array_equal(given.motion.stamps, STAMPS)
    assert given.frames is None
    assert given.camera is None


def test_a_bag_without_motion_takes_that_of_a_dataset(tmp_path: Path) -> None:
    names = {role: name for role, name in OURS.items() if role not in ("twist", "extrinsics")}
    path = write_messages(tmp_path / "bag", drive_messages(names))
    with pytest.raises(VislamError, match="nothing tells where frame 'camera_left_optical' is"):
        read_images(path)
    images = read_images(path, write_dataset(tmp_path / "motion.npz"))
    np.testing.assert_allclose(images.rig.T_body_left, T_BODY_LEFT, atol=1e-9)
    np.testing.assert_allclose(images.motion.twists[:, 1], -SPEED)


FAULTS = {
    "no camera info": (
        {**{r: n for r, n in OURS.items() if r != "right_info"}},
        "has no topic /stereo/right/camera_info",
    ),
    "no right image": (
        {**{r: n for r, n in OURS.items() if r != "right"}},
        "has no topic /stereo/right/image_raw",
    ),
    "no name that tells": (
        OURS | {"left": "/front/image", "right": "/back/image"},
        "no two are a pair: name them with --remap",
    ),
    "many pairs": (
        OURS | {"left": "/cam0/image", "right": "/cam1/image", "depth": "/cam2/image"},
        "more than two could be the pair",
    ),
    "two IMUs": (
        {r: n for r, n in OURS.items() if r != "twist"} | {"imu": "/a/imu", "gyro": "/b/imu"},
        "has 2 IMUs: name one of /a/imu, /b/imu",
    ),
}


@pytest.mark.parametrize(("names", "reason"), FAULTS.values(), ids=FAULTS)
def test_what_is_missing_is_named(names: dict[str, str], reason: str, tmp_path: Path) -> None:
    path = write_messages(tmp_path / "bag", drive_messages(names))
    with pytest.raises(VislamError, match=re.escape(reason)) as caught:
        read_images(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bad_image_is_named_with_its_stamp(tmp_path: Path) -> None:
    messages = drive_messages(OURS)
    bad = next(m for m in messages if m[0] == OURS["left"] and m[2] == STAMPS[4])
    bad[3].data = bad[3].data[:-1]
    images = read_images(write_messages(tmp_path / "bag", messages))
    with pytest.raises(VislamError, match=rf"left/image_raw at {STAMPS[4]} ns: data has"):
        list(images.pairs())


def test_sizes_that_differ_from_the_camera_infos_are_refused(tmp_path: Path) -> None:
    messages = drive_messages(OURS)
    for topic, _, _, message in messages:
        if topic == OURS["left_info"]:
            message.width = 640
    with pytest.raises(VislamError, match="have 160 x 120 pixels, and their camera_info 640 x 12"):
        read_images(write_messages(tmp_path / "bag", messages))


def test_extrinsics_go_along_a_chain_in_either_direction(tmp_path: Path) -> None:
    frame = "eye"
    messages = [m for m in drive_messages(REALSENSE, frame=frame) if m[0] != "/tf_static"]
    T_imu_mount = se3.exp([0.1, 0.2, 0.3, 0.4, -0.5, 0.6])
    first = int(STAMPS[0])
    chain = [
        transform(first, "imu_frame", "mount", T_imu_mount),
        transform(first, frame, "mount", np.eye(4)),
    ]
    tf = NEW["TFMessage"](transforms=chain)
    messages.insert(0, ("/tf_static", "tf2_msgs/msg/TFMessage", first, tf))
    rig = read_images(write_messages(tmp_path / "bag", messages)).rig
    np.testing.assert_allclose(rig.T_body_left, T_imu_mount, atol=1e-12)
