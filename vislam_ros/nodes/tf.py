# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms on /tf, with or without tf2_msgs (see vislam_ros.nodes.made_types)."""

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher

from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import TRANSFORMS
from vislam_ros.data.results.scene import transform_message
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.topics import message_class


class TransformSender:
    """Publishes transforms where that is possible, and says so once where it is not."""

    def __init__(self, node: Node, monitor: Monitor):
        self._monitor = monitor
        self._publisher: Publisher | None = None
        if message_class(TRANSFORMS.msgtype) is None:
            node.get_logger().info(
                f"tf2_msgs is not installed: nothing is published on {TRANSFORMS.name}"
            )
        else:
            self._publisher = monitor.advertise(TRANSFORMS)
            # The first message takes as long as a hundred others: its encoding is made with it.
            transform_message(TRANSFORMS, *decoding.transform(TransformStamped()))

    @property
    def is_heard(self) -> bool:
        """Whether a transform that is sent goes anywhere; who comes later gets later ones."""
        return self._publisher is not None and self._publisher.get_subscription_count() > 0

    def send(self, transform: TransformStamped) -> None:
        """Publish a transform."""
        if self._publisher is not None:
            made = transform_message(TRANSFORMS, *decoding.transform(transform))
            self._monitor.publish(self._publisher, made.data)
