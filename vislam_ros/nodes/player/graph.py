# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the nodes hear each other: what is sent before that is lost.

Only a publisher knows how many subscribers it has found, so the nodes tell it on ``/diagnostics``
as ``subscribers TOPIC``. There slam_node tells too which feature frames it is done with, also
those that it refused and will never answer.
"""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from vislam_ros.data.bags.layout import DIAGNOSTICS, FEATURES, ODOMETRY, PREDICTION, STEPS
from vislam_ros.data.results.completeness import NodeReport
from vislam_ros.nodes.diagnostics import neighbour
from vislam_ros.nodes.topics import STREAM

#: Topics between the nodes, and which nodes must hear them.
LINKS = {
    PREDICTION.name: ("slam_node", "recorder_node"),
    ODOMETRY.name: ("recorder_node",),
    STEPS.name: ("recorder_node",),
}

_KEY = "subscribers "


class GraphWatch:
    """Follows what the nodes report about their subscribers.

    Parameters
    ----------
    node : Node
        Asks and listens; some other thread spins it.
    on_frames : callable
        Called with how many feature frames slam_node has taken since :meth:`begin`, and how many
        of them wait for their prediction.
    """

    def __init__(self, node: Node, on_frames: Callable[[int, int], None]):
        self._node = node
        self._on_frames = on_frames
        self._taken = self._taken_before = 0
        self._found: dict[str, int] = {}
        node.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, STREAM)

    def begin(self) -> None:
        """Count frames from now on."""
        self._taken_before = self._taken

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            name = neighbour(self._node, status.name)
            if name is None:
                continue
            for entry in status.values:
                if entry.key.startswith(_KEY):
                    self._found[entry.key.removeprefix(_KEY)] = int(entry.value)
            if name == "slam_node":
                report = NodeReport.of_values({entry.key: entry.value for entry in status.values})
                self._taken = report.received.get(FEATURES.name, 0)
                self._on_frames(self._taken - self._taken_before, report.waiting)

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
