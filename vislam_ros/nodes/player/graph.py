# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the nodes hear each other: what is sent before that is lost.

Only a publisher knows how many subscribers it has found, so the nodes tell it on ``/diagnostics``
as ``subscribers TOPIC``.
"""

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from vislam_ros.nodes.qos import STREAM

#: Topics between the nodes, and which nodes must hear them.
LINKS = {
    "prediction/odometry": ("slam_node", "recorder_node"),
    "slam/odometry": ("recorder_node",),
    "slam/steps": ("recorder_node",),
}

_KEY = "subscribers "


class GraphWatch:
    """Follows what the nodes report about their subscribers.

    Parameters
    ----------
    node : Node
        Asks and listens; some other thread spins it.
    """

    def __init__(self, node: Node):
        self._node = node
        self._found: dict[str, int] = {}
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for entry in status.values:
                if entry.key.startswith(_KEY):
                    self._found[entry.key.removeprefix(_KEY)] = int(entry.value)

    def missing(self) -> list[str]:
        """Links that are not there yet, in words; empty where the graph is whole."""
        missing = []
        for topic, needed in LINKS.items():
            subscriptions = self._node.get_subscriptions_info_by_topic(topic)
            present = [subscription.node_name for subscription in subscriptions]
            absent = [name for name in needed if name not in present]
            if absent:
                missing.append(f"{' and '.join(absent)} on {topic}")
            elif self._found.get(topic, 0) < len(present):
                missing.append(f"the publisher of {topic}, which must find its subscribers")
        return missing
