# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node that listens to a player, and how to wait for what it should hear."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import FEATURES, IMU, ODOMETRY, PLAYER, TWIST, Topic
from vislam_ros.nodes import conversions
from vislam_ros.nodes.player.options import PlayOptions
from vislam_ros.nodes.topics import LATCHED, STREAM, message_class, qos_profile

WAIT = 30.0
STEPS = 40
FULL_SPEED = PlayOptions(rate=0.0, wait=WAIT)
STREAMS = (IMU, TWIST, FEATURES)
LATCHES = CALIBRATION_TOPICS


class Listener(Node):
    """Keeps the raw messages of topics, and answers features if it is told to."""

    def __init__(
        self,
        context: Context,
        *,
        topics: Iterable[Topic] = (*STREAMS, *LATCHES),
        delay: float = 0.0,
    ):
        super().__init__("listener", context=context)
        self.heard: defaultdict[str, list[bytes]] = defaultdict(list)
        self.delay = delay
        self.ahead: list[int] = []
        for topic in topics:
            self.listen(topic)
        self.states: list[dict[str, str]] = []
        self.create_subscription(DiagnosticArray, PLAYER.name, self._on_status, LATCHED)

    def listen(self, topic: Topic, name: str | None = None) -> None:
        heard = self.heard[name or topic.recorded]

        def keep(data: bytes) -> None:
            if self.delay:
                time.sleep(self.delay)
            heard.append(data)

        self.create_subscription(
            message_class(topic.msgtype),
            name or topic.recorded,
            keep,
            qos_profile(topic.qos),
            raw=True,
        )

    def answer_features(self, every: int, topic: Topic = FEATURES) -> None:
        """Answer every so many feature frames, or images, and note how many were unanswered."""
        odometry = self.create_publisher(Odometry, ODOMETRY.name, STREAM)
        waiting: list[Any] = []

        def answer(message: PointCloud2 | Image) -> None:
            waiting.append(message.header)
            self.ahead.append(len(waiting))
            if len(waiting) == every:
                odometry.publish(Odometry(header=waiting[-1]))
                waiting.clear()

        kind = message_class(topic.msgtype)
        self.create_subscription(kind, topic.recorded, answer, STREAM)

    def _on_status(self, message: DiagnosticArray) -> None:
        self.states.append(conversions.status_values(message, "player"))


def wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen"
        time.sleep(0.01)


def recorded(bag: BagMessages, topic: str, **part: int) -> list[bytes]:
    return [data for _, _, data in bag.messages([topic], **part)]
