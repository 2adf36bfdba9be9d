# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A context and a domain for each test, and a small drive as the messages of a bag."""

import itertools
import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Both are read when the first message or participant is made.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped, TwistWithCovarianceStamped, Vector3
from live.node_processes import Processes
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, PointCloud2

from vislam_ros.cli.domain import own_domain
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, Topic
from vislam_ros.nodes import conversions, recorder_node
from vislam_ros.nodes.recorder_node import RecorderNode

_counter = itertools.count()


@pytest.fixture
def domain_id() -> Iterator[int]:
    """A domain that no test and no run has at the same time."""
    with own_domain(os.getpid() + next(_counter)) as domain:
        yield domain


@pytest.fixture
def context(domain_id: int) -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture
def processes(domain_id: int) -> Iterator[Processes]:
    processes = Processes(domain_id)
    yield processes
    processes.end_all()


@pytest.fixture
def make_node(context: Context) -> Iterator[Callable[..., Any]]:
    """Make a node of a class with some parameters; it goes with the test."""
    nodes: list[Node] = []

    def make(cls: Callable[..., Node], **parameters: Any) -> Node:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = cls(context=context, parameter_overrides=overrides)
        nodes.append(node)
        return node

    yield make
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], dict[str, list[Any]]]:
    """Keep what a node publishes, by topic; it is published all the same."""

    def start(node: Any) -> dict[str, list[Any]]:
        published: dict[str, list[Any]] = defaultdict(list)
        publish = node.monitor.publish

        def keep(publisher: Any, message: Any) -> None:
            published[publisher.topic_name].append(message)
            publish(publisher, message)

        monkeypatch.setattr(node.monitor, "publish", keep)
        return published

    return start


@dataclass
class SmallDrive:
    """A straight drive through a cloud of points, as messages."""

    camera: StereoCamera
    left: CameraInfo
    right: CameraInfo
    extrinsics: TransformStamped
    stamps: list[int]
    twists: list[TwistWithCovarianceStamped]
    predictions: list[Odometry]
    features: list[PointCloud2]

    @property
    def calibration(self) -> list[tuple[Topic, Any]]:
        """The messages of the camera, with their topics."""
        messages = (self.left, self.right, self.extrinsics)
        return list(zip(CALIBRATION_TOPICS, messages, strict=True))

    def calibrate(self, node: Any) -> None:
        """Give a SLAM node its camera."""
        for topic, message in self.calibration:
            node.on_calibration(topic, message)


@pytest.fixture
def drive() -> SmallDrive:
    rng = np.random.default_rng(5)
    R_body_camera = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    T_body_camera = np.eye(4)
    T_body_camera[:3, :3], T_body_camera[:3, 3] = R_body_camera, (1.0, 0.2, 0.1)
    K = np.array([[500.0, 0, 320], [0, 500, 180], [0, 0, 1]])
    camera = StereoCamera.from_matrices(K, 0.5, T_body_camera)
    points = rng.uniform((6, -5, -2), (30, 5, 3), (40, 3))
    twist = np.array([2.0, 0, 0, 0, 0, 0.02])
    stamps = [1_317_000_000_000_000_123 + k * 100_000_000 for k in range(12)]
    T_world_body = np.eye(4)
    twists, predictions, features = [], [], []
    for k, stamp in enumerate(stamps):
        if k:
            T_world_body = T_world_body @ se3.exp(0.1 * twist)
        twists.append(twist_message(stamp, twist))
        predictions.append(prediction_message(stamp, T_world_body))
        T_camera_world = camera.T_camera_body @ se3.inverse(T_world_body)
        y = camera.project(points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3])
        y += rng.normal(0, 0.5, y.shape)
        pixels = y[:, [0, 2, 1, 2]].astype(np.float32)
        ids = np.arange(len(points), dtype=np.uint32)
        features.append(conversions.features_to_message(stamp, DEFAULT_FRAMES.camera, ids, pixels))
    left, right = camera_info(camera, 0.0), camera_info(camera, -camera.fx_baseline)
    extrinsics = conversions.transform(
        stamps[0],
        DEFAULT_FRAMES.base,
        DEFAULT_FRAMES.camera,
        camera.position_body_camera,
        camera.quaternion_body_camera,
    )
    return SmallDrive(camera, left, right, extrinsics, stamps, twists, predictions, features)


def twist_message(stamp: int, twist: Any) -> TwistWithCovarianceStamped:
    message = TwistWithCovarianceStamped(header=conversions.header(stamp, DEFAULT_FRAMES.base))
    v, omega = map(float, twist[:3]), map(float, twist[3:])
    message.twist.twist.linear = Vector3(**dict(zip("xyz", v, strict=True)))
    message.twist.twist.angular = Vector3(**dict(zip("xyz", omega, strict=True)))
    return message


def prediction_message(stamp: int, T_odom_body: Any) -> Odometry:
    return conversions.odometry(
        stamp,
        DEFAULT_FRAMES.odom,
        DEFAULT_FRAMES.base,
        T_odom_body[:3, 3],
        se3.quaternion_from_rotation(T_odom_body[:3, :3]),
        np.eye(6),
    )


def camera_info(camera: StereoCamera, offset: float) -> CameraInfo:
    message = CameraInfo(header=conversions.header(0, DEFAULT_FRAMES.camera))
    p = [camera.fx, 0.0, camera.cx, offset, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    message.p = np.array(p)
    return message


@pytest.fixture
def answers(drive: SmallDrive) -> tuple[list[Any], Any]:
    """What the SLAM node answers to the small drive: steps, and the map at the end."""
    core = Slam(SlamSettings())
    core.set_camera(drive.camera)
    steps = []
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        steps += core.add_prediction(*decoding.pose(prediction))
        steps += core.add_features(*decoding.features(features, DEFAULT_FRAMES))
    return steps, core.landmarks()


@pytest.fixture
def recorder(make_node: Callable[..., Any], tmp_path: Path) -> Any:
    return make_node(RecorderNode, directory=str(tmp_path / "run"))


@pytest.fixture
def no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody answers in these tests, so there is no use in waiting."""
    monkeypatch.setattr(recorder_node, "GRACE_SECONDS", 0.05)
    monkeypatch.setattr(recorder_node, "ANSWER_SECONDS", 0.05)
