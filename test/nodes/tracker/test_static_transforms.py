# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where nobody publishes extrinsics, static transforms tell where the camera is, as in bags."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from imagery.bags import NEW, OURS, STORE, drive_messages, transform, write_messages
from imagery.folders import FRAMES, STAMPS, T_BODY_LEFT
from live.node_processes import spin_until
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from vislam_ros.core.geometry import se3
from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags import layout
from vislam_ros.data.bags.layout import EXTRINSICS, LEFT_CAMERA, RIGHT_CAMERA, Frames, Topic
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.nodes.stereo_tracker_node import StereoTrackerNode
from vislam_ros.nodes.topics import LATCHED, message_class
from vislam_ros.nodes.tracker.cameras import HEARD_TRANSFORMS, RawCameras

FEATURES = layout.FEATURES.recorded
BODY, EYE = "imu_frame", "left_eye"
FIRST = int(STAMPS[0])
T_MOUNT_BODY = se3.exp([0.3, -0.1, 0.2, 0.5, 0.4, -0.6])
T_MOUNT_EYE = T_MOUNT_BODY @ T_BODY_LEFT
LINKS = (
    transform(FIRST, "mount", BODY, T_MOUNT_BODY),
    transform(FIRST, "/mount", EYE, T_MOUNT_EYE),
)
NAMES = {**{role: name for role, name in OURS.items() if role not in ("extrinsics", "twist")}}
NAMES |= {"imu": "/imu/data"}
CAMERAS = (LEFT_CAMERA, RIGHT_CAMERA)


def of_links(*links: Any) -> Any:
    return NEW["TFMessage"](transforms=list(links))


def messages() -> list[Any]:
    """Messages of the small drive, but for where its camera is."""
    return drive_messages(NAMES, frame=EYE)


def infos() -> dict[Topic, Any]:
    by_name = {name: message for name, _, _, message in messages()}
    return {topic: by_name[topic.recorded] for topic in CAMERAS}


def take(node: Any, topic: Topic, msgtype: str, message: Any) -> None:
    node.monitor.take(topic, bytes(STORE.serialize_cdr(message, msgtype)))


def send(node: Any) -> None:
    topics = {topic.recorded: topic for topic in (*layout.TOPICS, *layout.IMAGES)}
    for name, msgtype, _, message in messages():
        take(node, topics[name], msgtype, message)


def cameras(**options: Any) -> RawCameras:
    return RawCameras(Frames(base=BODY, camera=EYE), rectified=False, **options)


def test_transforms_of_several_publishers_give_the_features_of_a_bag_with_them(
    make_node: Any, context: Any, capture: Any, tmp_path: Any
) -> None:
    cls = message_class(HEARD_TRANSFORMS.msgtype)
    if cls is None:
        pytest.skip("tf2_msgs is not installed, nor can its type be made")
    static = ("/tf_static", HEARD_TRANSFORMS.msgtype, FIRST, of_links(*LINKS))
    path = write_messages(tmp_path / "bag", [static, *messages()])
    offline = tracked_drive(read_images(path))

    # Latched, each of its own node, before the tracker is there, as robots have them.
    executor = SingleThreadedExecutor(context=context)
    for k, link in enumerate(LINKS):
        broadcaster = make_node(lambda k=k, **options: Node(f"broadcaster_{k}", **options))
        publisher = broadcaster.create_publisher(cls, HEARD_TRANSFORMS.name, LATCHED)
        publisher.publish(bytes(STORE.serialize_cdr(of_links(link), HEARD_TRANSFORMS.msgtype)))
        executor.add_node(broadcaster)
    node = make_node(StereoTrackerNode, base_frame=BODY, camera_frame=EYE, gyroscope="required")
    published = capture(node)
    executor.add_node(node)
    send(node)
    assert node._describe()[0] == (
        "waiting for calibration: stereo/extrinsics, or /tf_static from 'imu_frame' to 'left_eye'"
    )
    spin_until(executor, lambda: len(published[FEATURES]) == FRAMES, "the features")
    executor.shutdown()
    (rectified,) = published[layout.RECTIFIED_CALIBRATION[2].recorded]
    told = rectified.transform.translation
    assert (told.x, told.y, told.z) == offline.camera.position_body_camera
    turned = rectified.transform.rotation
    found = (turned.x, turned.y, turned.z, turned.w)
    assert found == offline.camera.quaternion_body_camera
    assert not node.monitor.refused.counts


def in_turn(told: RawCameras, *steps: Callable[[RawCameras], bool]) -> list[bool]:
    return [step(told) for step in steps]


def link(k: int) -> Callable[[RawCameras], bool]:
    def add(told: RawCameras) -> bool:
        told.transforms.add([LINKS[k]])
        return told.settle()

    return add


def info(topic: Topic) -> Callable[[RawCameras], bool]:
    return lambda told: told.add(topic, infos()[topic])


@pytest.mark.parametrize(
    "steps",
    [
        (link(0), link(1), info(LEFT_CAMERA), info(RIGHT_CAMERA)),
        (info(RIGHT_CAMERA), link(1), info(LEFT_CAMERA), link(0)),
    ],
)
def test_the_rig_is_there_with_the_last_of_what_tells_it(steps: Any) -> None:
    told = cameras()
    assert in_turn(told, *steps) == [False, False, False, True]
    assert told.rig is not None
    np.testing.assert_allclose(told.rig.T_body_left, T_BODY_LEFT, atol=1e-12)
    assert not told.missing()
    assert in_turn(told, *steps) == [False] * 4, "nothing changed"


def test_extrinsics_count_for_more_than_transforms() -> None:
    told = cameras()
    in_turn(told, link(0), link(1), info(LEFT_CAMERA), info(RIGHT_CAMERA))
    T = se3.exp([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]) @ T_BODY_LEFT
    assert told.add(EXTRINSICS, transform(FIRST, BODY, EYE, T))
    assert told.rig is not None
    np.testing.assert_allclose(told.rig.T_body_left, T, atol=1e-12)
    assert not link(0)(told)


def test_extrinsics_that_say_what_transforms_said_change_no_bit() -> None:
    told = cameras()
    mount = transform(FIRST, BODY, EYE, T_BODY_LEFT)
    in_turn(told, info(LEFT_CAMERA), info(RIGHT_CAMERA))
    told.transforms.add([mount])
    assert told.settle()
    assert not told.add(EXTRINSICS, mount)


def test_whoever_publishes_extrinsics_is_waited_for() -> None:
    come = [True]
    told = cameras(extrinsics_come=lambda: come[0])
    in_turn(told, link(0), link(1), info(LEFT_CAMERA), info(RIGHT_CAMERA))
    assert told.missing() == ["stereo/extrinsics"]
    come[0] = False
    assert told.add(LEFT_CAMERA, infos()[LEFT_CAMERA]), "told again, as drivers do"


def test_a_bad_transform_costs_none_beside_it(make_node: Any, capture: Any) -> None:
    node = make_node(StereoTrackerNode, base_frame=BODY, camera_frame=EYE)
    published = capture(node)
    bad = transform(FIRST, "mount", "antenna", np.eye(4))
    bad.transform.rotation.w = 0.0
    take(node, HEARD_TRANSFORMS, HEARD_TRANSFORMS.msgtype, of_links(bad, *LINKS))
    send(node)
    assert node.monitor.refused.counts == {"tf_static_not_a_rotation": 1}
    assert len(published[FEATURES]) == FRAMES


def test_a_camera_a_mile_from_its_body_is_refused() -> None:
    told = cameras()
    far = np.eye(4)
    far[0, 3] = 2000.0
    told.transforms.add([transform(FIRST, BODY, EYE, far)])
    with pytest.raises(RefusedMessage, match="2000"):
        told.add(LEFT_CAMERA, infos()[LEFT_CAMERA])


def test_bytes_that_are_no_transforms_are_refused(make_node: Any) -> None:
    node = make_node(StereoTrackerNode)
    node.monitor.take(HEARD_TRANSFORMS, b"\x00\x01\x00\x00\xff\xff\xff\xffnothing")
    assert node.monitor.refused.counts == {"tf_static_undecodable": 1}
