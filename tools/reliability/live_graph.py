# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes on a domain of their own, and a node that talks to them and hears them."""

import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from vislam_ros.cli.domain import local_graph, own_domain
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import DIAGNOSTICS, ODOMETRY, PREDICTION, Topic
from vislam_ros.errors import VislamError
from vislam_ros.nodes.topics import message_class, qos_profile

START_SECONDS = 60.0
"""How long the nodes may take to start and to find each other."""

_PARTING_SECONDS = 10.0


class Talker(Node):
    """Sends CDR bytes, and keeps the poses and the reports that come.

    Attributes
    ----------
    poses : list of (int, bytes)
        Stamp (ns), and position and quaternion, of each ``slam/odometry``.
    sent : Counter of str
        Messages by topic.
    """

    def __init__(self, context: Context, topics: Sequence[Topic]):
        super().__init__("talker", context=context)
        self.poses: list[tuple[int, bytes]] = []
        self.sent: Counter[str] = Counter()
        self._reports: dict[str, dict[str, str]] = {}
        self._senders = {
            topic: self.create_publisher(
                message_class(topic.msgtype), topic.name, qos_profile(topic.qos)
            )
            for topic in topics
        }
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        stream = qos_profile(ODOMETRY.qos)
        self.create_subscription(Odometry, ODOMETRY.name, self._on_odometry, stream)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, stream)

    def _on_odometry(self, message: Odometry) -> None:
        stamp, position, quaternion = decoding.pose(message)
        self.poses.append((stamp, position.tobytes() + quaternion.tobytes()))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node = status.name.rpartition("/")[2]
            self._reports[node] = {entry.key: entry.value for entry in status.values}

    def send(self, topic: Topic, data: bytes) -> None:
        """Send a message as it is."""
        self._senders[topic].publish(data)
        self.sent[topic.name] += 1
        self._executor.spin_once(timeout_sec=0.0)

    def until(self, is_so: Callable[[], bool], seconds: float) -> bool:
        """Hear what comes until a condition holds; tell whether it does in that time."""
        end = time.monotonic() + seconds
        while not is_so():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def is_connected(self) -> bool:
        """Whether what is sent is heard, and the nodes hear each other and are heard."""
        links = [ODOMETRY.name]
        if "imu_prediction_node" in self._reports or PREDICTION not in self._senders:
            links.append(PREDICTION.name)
        return all(self._value(f"subscribers {link}") > 0 for link in links) and all(
            sender.get_subscription_count() for sender in self._senders.values()
        )

    def has_arrived(self) -> bool:
        """Whether the nodes have reported each message that was sent."""
        return all(self._value(f"received {topic}") >= n for topic, n in self.sent.items())

    def refused(self) -> Counter[str]:
        """Messages that the nodes have refused so far, by word."""
        return Counter(
            {
                key.removeprefix("refused "): int(value)
                for report in self._reports.values()
                for key, value in report.items()
                if key.startswith("refused ")
            }
        )

    def _value(self, key: str) -> int:
        return max((int(report.get(key, 0)) for report in self._reports.values()), default=0)

    def close(self) -> None:
        """End it."""
        self._executor.shutdown()
        self.destroy_node()


@contextmanager
def live_graph(nodes: Sequence[str], topics: Sequence[Topic]) -> Iterator[Talker]:
    """Start nodes, and wait until they hear what is sent on the topics and each other.

    Parameters
    ----------
    nodes : sequence of str
        Modules of :mod:`vislam_ros.nodes`.
    topics : sequence of Topic

    Raises
    ------
    VislamError
        Where they do not come together.
    """
    for name, value in local_graph().items():
        os.environ.setdefault(name, value)
    with own_domain() as domain, _processes(nodes, domain):
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        talker = Talker(context, topics)
        try:
            if not talker.until(talker.is_connected, START_SECONDS):
                raise VislamError(f"{' and '.join(nodes)} did not start in {START_SECONDS:g} s")
            yield talker
        finally:
            talker.close()
            rclpy.try_shutdown(context=context)


@contextmanager
def _processes(nodes: Sequence[str], domain: int) -> Iterator[None]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    started = [
        subprocess.Popen(
            [sys.executable, "-m", f"vislam_ros.nodes.{node}"],
            env=environment,
            stderr=subprocess.DEVNULL,
        )
        for node in nodes
    ]
    try:
        yield
    finally:
        for process in started:
            process.terminate()
        for process in started:
            with suppress(subprocess.TimeoutExpired):
                process.wait(_PARTING_SECONDS)
            process.kill()
            process.wait()
