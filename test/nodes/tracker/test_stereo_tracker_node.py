# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tracker node takes images as drivers send them, and refuses those that will not do."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from imagery.bags import (
    OURS,
    STORE,
    camera_info,
    compressed_message,
    drive_messages,
    image_message,
    write_messages,
)
from imagery.folders import BASELINE, FOCAL, FRAMES, STAMPS, pair
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image

from vislam_ros.data.bags import decoding, layout
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, Topic
from vislam_ros.data.drive import Drive
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.nodes.stereo_tracker_node import StereoTrackerNode
from vislam_ros.nodes.tracker.cameras import HEARD_TRANSFORMS

NAMES = {**OURS, "imu": "/imu/data"}
FEATURES = layout.FEATURES.recorded
IMAGE, COMPRESSED = layout.LEFT_IMAGE.msgtype, layout.COMPRESSED_IMAGE
TOPICS = {topic.recorded: topic for topic in (*layout.TOPICS, *layout.IMAGES)}
TOPICS["/tf_static"] = HEARD_TRANSFORMS

Message = tuple[str, str, int, Any]
Published = dict[str, list[Any]]


def messages(*, compressed: bool = False) -> list[Message]:
    """Messages of the small drive; its IMU is the body here."""
    names = {**NAMES}
    if compressed:
        names |= {side: f"{NAMES[side]}/compressed" for side in ("left", "right")}
    drive = drive_messages(names, compressed=compressed)
    for name, _, _, message in drive:
        if name == "/imu/data":
            message.header.frame_id = "base_link"
    return drive


def send(node: Any, sent: Iterable[Message]) -> None:
    """Give a node messages as they come from the wire, if it hears their topic."""
    for name, msgtype, _, message in sent:
        if name != "/imu/twist":
            topic: Topic = TOPICS[name]
            node.monitor.take(topic, bytes(STORE.serialize_cdr(message, msgtype)))


def changed(drive: list[Message], role: str, k: int, message: Any) -> list[Message]:
    """Messages of which the k-th of a role is another one."""
    places = [place for place, entry in enumerate(drive) if entry[0] == NAMES[role]]
    name, msgtype, stamp, _ = drive[places[k]]
    return [
        *drive[: places[k]],
        (name, msgtype, stamp, message),
        *drive[places[k] + 1 :],
    ]


@pytest.fixture(scope="module")
def offline(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    path = write_messages(tmp_path_factory.mktemp("images") / "bag", messages())
    return tracked_drive(read_images(path))


def assert_features(published: Published, drive: Drive, left_out: tuple[int, ...] = ()) -> None:
    found = published[FEATURES]
    frames = [k for k in range(FRAMES) if k not in left_out]
    assert [decoding.stamp_of(m.header) for m in found] == STAMPS[frames].tolist()
    if not left_out:
        for k, message in enumerate(found):
            _, ids, pixels, noise = decoding.features(message, DEFAULT_FRAMES)
            rows = slice(drive.offsets[k], drive.offsets[k + 1])
            assert ids.tobytes() == drive.ids[rows].tobytes()
            assert pixels.tobytes() == drive.pixels[rows].tobytes()
            assert noise is not None
            assert drive.noise is not None
            assert noise.tobytes() == drive.noise[rows].tobytes()


def by_topic(drive: list[Message]) -> list[Message]:
    return sorted(drive, key=lambda message: message[0])


def motion_last(drive: list[Message]) -> list[Message]:
    return sorted(drive, key=lambda message: message[0] == "/imu/data")


def cameras_last(drive: list[Message]) -> list[Message]:
    return sorted(drive, key=lambda m: m[0].endswith(("camera_info", "extrinsics")))


@pytest.mark.parametrize("order", [list, by_topic, motion_last, cameras_last])
def test_features_are_those_of_offline_byte_for_byte_in_whatever_order_messages_come(
    make_node: Any, capture: Any, offline: Drive, order: Callable[[list[Message]], list[Message]]
) -> None:
    node = make_node(StereoTrackerNode, gyroscope="required")
    published = capture(node)
    send(node, order(messages()))
    assert_features(published, offline)
    assert not node.monitor.refused.counts
    assert {m.header.frame_id for m in published[FEATURES]} == {"camera_left_optical"}


def test_compressed_images_give_the_same(make_node: Any, capture: Any, offline: Drive) -> None:
    node = make_node(StereoTrackerNode, compressed=True, gyroscope="required")
    published = capture(node)
    send(node, messages(compressed=True))
    assert_features(published, offline)


def test_the_rectified_cameras_are_those_of_the_features(
    make_node: Any, capture: Any, offline: Drive
) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    send(node, messages())
    heard = Calibration(DEFAULT_FRAMES)
    for topic, ours in zip(layout.RECTIFIED_CALIBRATION, CALIBRATION_TOPICS, strict=True):
        (message,) = published[topic.recorded]
        heard.add(ours, message)
    assert heard.camera == offline.camera
    assert heard.rectification is None
    assert heard.image_size == offline.image_size


def test_a_right_camera_that_looks_aside_is_rectified(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    angle = 0.02
    R = np.array(
        [
            [np.cos(angle), 0, np.sin(angle)],
            [0, 1, 0],
            [-np.sin(angle), 0, np.cos(angle)],
        ]
    )
    turned = camera_info("camera_left_optical", -FOCAL * BASELINE, R=R)
    send(node, changed(messages(), "right_info", 0, turned))
    left, right, _ = (published[topic.recorded][0] for topic in layout.RECTIFIED_CALIBRATION)
    assert left.p[0] == right.p[0] != FOCAL
    assert right.p[3] == pytest.approx(-right.p[0] * BASELINE)
    assert list(left.r) == np.eye(3).ravel().tolist()


def image_of(k: int, **fields: Any) -> Any:
    message = image_message(int(STAMPS[k]), "camera_left_optical", pair(k)[0])
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"encoding": "yuv422"}, "left_image_bad_fields"),
        ({"data": np.zeros(100, np.uint8)}, "left_image_wrong_size"),
        ({"width": 0, "data": np.zeros(0, np.uint8)}, "left_image_wrong_size"),
    ],
)
def test_an_image_that_cannot_be_read_costs_its_pair_alone(
    make_node: Any, capture: Any, offline: Drive, fields: dict[str, Any], word: str
) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    send(node, changed(messages(), "left", 3, image_of(3, **fields)))
    assert_features(published, offline, left_out=(3,))
    assert node.monitor.refused.counts == {word: 1, "right_image_unpaired": 1}


def test_an_image_of_another_size_than_its_camera_is_refused(
    make_node: Any, capture: Any, offline: Drive
) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    small = image_message(int(STAMPS[3]), "camera_left_optical", pair(3)[0][::2, ::2].copy())
    send(node, changed(messages(), "left", 3, small))
    assert_features(published, offline, left_out=(3,))
    assert node.monitor.refused.counts == {"images_wrong_size": 1}


def test_bytes_that_are_no_compressed_image_are_refused(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode, compressed=True)
    published = capture(node)
    drive = messages(compressed=True)
    for claim in (b"", b"\x89PNG\r\n\x1a\n", bytes(1000)):
        message = compressed_message(int(STAMPS[0]), "camera_left_optical", pair(0)[0])
        message.data = np.frombuffer(claim, np.uint8)
        send(node, [(f"{NAMES['left']}/compressed", COMPRESSED, 0, message)])
    assert node.monitor.refused.counts == {"left_image_undecodable": 3}
    send(node, drive)
    assert len(published[FEATURES]) == FRAMES


def test_bytes_that_are_no_message_are_refused(make_node: Any) -> None:
    node = make_node(StereoTrackerNode)
    node.monitor.take(layout.LEFT_IMAGE, b"\x00\x01\x00\x00nothing")
    assert node.monitor.refused.counts == {"left_image_undecodable": 1}


def test_an_image_before_1970_is_refused(make_node: Any) -> None:
    node = make_node(StereoTrackerNode)
    message = image_of(0)
    message.header.stamp.sec = -5
    send(node, [(NAMES["left"], IMAGE, 0, message)])
    assert node.monitor.refused.counts == {"left_image_before_1970": 1}


def test_an_image_over_again_is_counted_and_not_published(
    make_node: Any, capture: Any, offline: Drive
) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    drive = messages()
    for side in (0, 1):
        again = image_message(int(STAMPS[4]), "camera_left_optical", pair(3)[side])
        drive = changed(drive, ("left", "right")[side], 4, again)
    send(node, drive)
    assert_features(published, offline, left_out=(4,))
    _, values = node._describe()
    assert (values["pairs"], values["repeated pairs"]) == (FRAMES, 1)
    assert values["features published"] == FRAMES - 1


def test_cameras_that_are_no_pair_are_refused_and_it_waits(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    exchanged = camera_info("camera_left_optical", FOCAL * BASELINE)
    send(node, changed(messages(), "right_info", 0, exchanged))
    assert not published[FEATURES]
    assert node.monitor.refused.counts == {"camera_info_not_a_pair": 1}
    assert node._describe()[0] == "waiting for calibration: stereo/right/camera_info"
    good = [entry for entry in messages() if entry[0] == NAMES["right_info"]]
    send(node, good)
    assert len(published[FEATURES]) == FRAMES


def test_a_turn_of_another_frame_is_refused_and_images_go_on(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    send(node, drive_messages(NAMES))
    assert node.monitor.refused.counts == {"imu_unknown_frame": FRAMES}
    assert len(published[FEATURES]) == FRAMES


def test_a_driver_s_rectified_images_are_known_by_their_name(make_node: Any, context: Any) -> None:
    rule = ["--ros-args", "-r", "stereo/left/image_raw:=/camera/infra1/image_rect_raw"]
    node = StereoTrackerNode(context=context, cli_args=rule)
    try:
        assert node._are_rectified()
    finally:
        node.destroy_node()
    assert not make_node(StereoTrackerNode)._are_rectified()
    assert make_node(StereoTrackerNode, images="rectified")._are_rectified()


def test_fewer_points_are_followed_from_the_next_pair_on(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    drive = messages()
    half = next(k for k, entry in enumerate(drive) if entry[2] == STAMPS[4])
    send(node, drive[:half])
    node.set_parameters([Parameter("max_features", value=5)])
    send(node, drive[half:])
    _, first, _, _ = decoding.features(published[FEATURES][3], DEFAULT_FRAMES)
    _, last, _, _ = decoding.features(published[FEATURES][-1], DEFAULT_FRAMES)
    assert last.max() <= first.max(), "no point was begun after the change"


def test_the_picture_of_the_tracks_is_made_for_those_who_look(
    make_node: Any, capture: Any, context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = make_node(StereoTrackerNode)
    published = capture(node)
    send(node, messages())
    assert not published[layout.TRACK_IMAGE.recorded]
    monkeypatch.setattr(node._pictures, "get_subscription_count", lambda: 1)
    again = make_node(StereoTrackerNode)
    published = capture(again)
    monkeypatch.setattr(again._pictures, "get_subscription_count", lambda: 1)
    send(again, messages())
    pictures: list[Image] = published[layout.TRACK_IMAGE.recorded]
    assert len(pictures) == FRAMES
    last = pictures[-1]
    pixels = np.frombuffer(last.data, np.uint8).reshape(last.height, last.width, 3)
    assert (last.encoding, last.step) == ("bgr8", 3 * last.width)
    assert np.any(pixels[..., 0] != pixels[..., 2]), "the tracks are in colour"


def test_it_says_what_would_be_lost_if_it_ended_now(make_node: Any) -> None:
    node = make_node(StereoTrackerNode, gyroscope="required")
    send(node, [entry for entry in messages() if entry[0] != "/imu/data"])
    _, values = node._describe()
    assert values["at end refused images_no_prediction"] == FRAMES - 1
    assert values["pairs waiting"] == FRAMES - 1
