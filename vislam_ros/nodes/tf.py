# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms on /tf, where tf2_msgs is installed: a full ROS has it, the one from PyPI not."""

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher

from vislam_ros.nodes.diagnostics import Monitor

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None


class TransformSender:
    """Publishes transforms where that is possible, and says so once where it is not."""

    def __init__(self, node: Node, monitor: Monitor):
        self._monitor = monitor
        self._publisher: Publisher | None = None
        if TFMessage is None:
            node.get_logger().info("tf2_msgs is not installed: nothing is published on /tf")
        else:
            self._publisher = monitor.advertise(TFMessage, "/tf")

    @property
    def works(self) -> bool:
        """Whether a transform that is sent goes anywhere."""
        return self._publisher is not None

    def send(self, transform: TransformStamped) -> None:
        """Publish a transform."""
        if self._publisher is not None:
            self._monitor.publish(self._publisher, TFMessage(transforms=[transform]))
