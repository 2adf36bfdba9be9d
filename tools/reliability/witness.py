# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A witness beside the recorder: ``python -m reliability.witness`` prints the stamps of poses."""

import signal
import sys
from typing import Any

import rclpy
from nav_msgs.msg import Odometry

from vislam_ros.data.bags.decoding import stamp_of
from vislam_ros.data.bags.layout import ODOMETRY
from vislam_ros.nodes.spin import spinning
from vislam_ros.nodes.topics import STREAM

READY = "ready"


def _say(message: Any) -> None:
    print(stamp_of(message.header))


def main() -> None:
    """Listen until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is for the one that it watches
    rclpy.init()
    node = rclpy.create_node("witness")
    node.create_subscription(Odometry, ODOMETRY.name, _say, STREAM)
    with spinning(node):
        print(READY)
        sys.stdin.read()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
