# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hears what passes between the nodes: ``python -m reliability.load.listener``.

A line for each message: topic, stamp, when it was published, when it came (ns of the system's
clock), its bytes, and, of a step, the latency that slam_node told (ms).
"""

import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message

from reliability.load.latency import OF_DRIVES, OF_IMAGES
from vislam_ros.data.bags.decoding import stamp_of
from vislam_ros.data.bags.layout import STEPS, Topic
from vislam_ros.nodes.conversions import status_values
from vislam_ros.nodes.slam_report import row_from_values
from vislam_ros.nodes.topics import STREAM, message_class

READY = "ready"
IMAGES = "images"
"""An argument: listen to images."""

_POLL_SECONDS = 0.1


def _teller(topic: Topic, lines: list[tuple[Topic, int, int, bytes]]) -> Callable[..., None]:
    def hear(data: bytes, info: Any) -> None:
        lines.append((topic, info["source_timestamp"], time.time_ns(), data))

    return hear


def _say(topic: Topic, published: int, came: int, data: bytes) -> None:
    message = deserialize_message(data, message_class(topic.msgtype))
    latency_ms = 0.0
    if topic is STEPS:
        _, latency_ms, _ = row_from_values(status_values(message, "slam_step"))
    stamp = stamp_of(message.header)
    print(topic.name, stamp, published, came, len(data), latency_ms)


def main() -> None:
    """Listen until standard input ends, then tell: to tell at once would cost the others time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    rclpy.init()
    node = rclpy.create_node("listener")
    heard: list[tuple[Topic, int, int, bytes]] = []
    for topic in OF_IMAGES if sys.argv[1:] == [IMAGES] else OF_DRIVES:
        cls = message_class(topic.msgtype)
        node.create_subscription(cls, topic.name, _teller(topic, heard), STREAM, raw=True)
    # The executor of the nodes does not tell when a message was published.
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    watch = threading.Thread(target=sys.stdin.read)
    watch.start()
    print(READY, flush=True)
    while watch.is_alive():
        executor.spin_once(timeout_sec=_POLL_SECONDS)
    executor.shutdown()
    for one in heard:
        _say(*one)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
