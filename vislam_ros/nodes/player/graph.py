# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes say of themselves: whether they hear each other, and what has reached them.

Only a publisher knows how many subscribers it has found, so the nodes tell it on ``/diagnostics``
as ``subscribers TOPIC``; what is sent before that is lost. There they tell too what they were
sent, and slam_node which feature frames it is done with, also those that it refused and will never
answer. A node that is busy tells nothing.
"""

import time
from collections import defaultdict
from collections.abc import Iterable, Mapping

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    FEATURES,
    IMU,
    ODOMETRY,
    PREDICTION,
    STEPS,
    TWIST,
)
from vislam_ros.data.results.completeness import (
    TRACKER,
    Ledger,
    NodeReport,
    counts_from_values,
)
from vislam_ros.nodes.diagnostics import neighbour
from vislam_ros.nodes.player.outlets import Outlet
from vislam_ros.nodes.player.window import FeatureWindow
from vislam_ros.nodes.subscribing import is_named
from vislam_ros.nodes.topics import STREAM

#: Topics between the nodes, and which nodes must hear them.
LINKS = {
    PREDICTION.name: ("slam_node", "recorder_node"),
    ODOMETRY.name: ("recorder_node",),
    STEPS.name: ("recorder_node",),
}
#: Which node publishes them.
PUBLISHERS = {
    PREDICTION.name: "imu_prediction_node",
    ODOMETRY.name: "slam_node",
    STEPS.name: "slam_node",
    FEATURES.name: TRACKER,
}
#: Nodes that what is played goes through.
REPORTING = ("imu_prediction_node", "slam_node", TRACKER)

_KEY = "subscribers "
# A node at work or at leisure reports every second.
_SILENCE_SECONDS = 2.0


class GraphWatch:
    """Follows what the nodes report.

    Parameters
    ----------
    node : Node
        Asks and listens; some other thread spins it.
    window : FeatureWindow
        Is told which frames slam_node is done with.
    """

    def __init__(self, node: Node, window: FeatureWindow):
        self._node = node
        self._window = window
        self._ledger = Ledger()
        self._found: dict[str, int] = {}
        self._reported: dict[str, float] = {}  # when last
        self._knows = False
        node.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, STREAM)

    def begin(self) -> None:
        """Count what the nodes are sent from now on."""
        self._ledger.begin()
        self._knows = "slam_node" in self._reported and not self.silent()

    def silent(self) -> list[str]:
        """Nodes that are there and have not reported yet."""
        return [name for name in self._present() if name not in self._reported]

    def is_busy(self) -> bool:
        """Tell whether a node that used to report has said nothing for long."""
        latest = time.monotonic() - _SILENCE_SECONDS
        return any(self._reported.get(name, latest) < latest for name in self._present())

    def is_at_rest(self, sent: Mapping[str, int]) -> bool:
        """Tell whether the nodes have taken all that was sent, by topic, and what comes of it."""
        self._ledger.set_sent(sent)
        return self._knows and not self._ledger.missing()

    def _present(self) -> list[str]:
        """Nodes that are there, by whichever of their ends was found first."""
        names = {end.node_name for ends in self._ends().values() for end in ends}
        return [name for name in REPORTING if name in names]

    def _ends(self) -> dict[str, list[TopicEndpointInfo]]:
        """Ends of topics by which a node is known to be there."""
        node = self._node
        ends: dict[str, list[TopicEndpointInfo]] = defaultdict(list)
        for topic in PUBLISHERS:
            ends[topic] += node.get_publishers_info_by_topic(topic)
        for topic in (TWIST.name, IMU.name, FEATURES.name, *LINKS):
            ends[topic] += node.get_subscriptions_info_by_topic(topic)
        return ends

    def _unnamed(self) -> list[str]:
        """Topics with an end of somebody who is there, and of whom it is not known yet who."""
        return [topic for topic, ends in self._ends().items() if not all(map(is_named, ends))]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            name = neighbour(self._node, status.name)
            if name is None:
                continue
            try:
                self._hear(name, {entry.key: entry.value for entry in status.values})
            except RefusedMessage as error:
                # Anybody may speak on /diagnostics, under any name.
                self._node.get_logger().warning(
                    f"passed over a status of {name}: {error}", throttle_duration_sec=10.0
                )

    def _hear(self, name: str, values: Mapping[str, str]) -> None:
        """Take the values of a node's status."""
        found = counts_from_values(values, _KEY)
        report = NodeReport.of_values(values) if name in REPORTING else None
        self._found.update(found)
        if report is None:
            return
        self._ledger.set_report(name, report)
        self._reported[name] = time.monotonic()
        if self._knows and name == "slam_node":
            taken = self._ledger.received(name, FEATURES.name)
            self._window.settle(taken, report.waiting)

    def missing(self, for_tracker: Iterable[Outlet] = (), *, whole: bool) -> list[str]:
        """Links that are not there yet, in words.

        Parameters
        ----------
        for_tracker : iterable of Outlet
            What is played of what the tracker hears: then it is one of the nodes.
        whole : bool
            Whether all of the nodes must be there, or only those that are must hear each other.
        """
        missing = [f"the name of a node on {topic}" for topic in self._unnamed()]
        links, nodes = LINKS, self._present()
        for outlet in for_tracker:
            links = {**LINKS, FEATURES.name: ("slam_node",)}
            hearers = [
                one.node_name for one in self._node.get_subscriptions_info_by_topic(outlet.name)
            ]
            if whole and (TRACKER not in hearers or outlet.subscribers < len(hearers)):
                missing.append(f"{TRACKER} on {outlet.name}")
        for topic, needed in links.items():
            subscriptions = self._node.get_subscriptions_info_by_topic(topic)
            present = [subscription.node_name for subscription in subscriptions]
            expected = whole or PUBLISHERS[topic] in nodes
            absent = [n for n in needed if n not in present and (whole or n in nodes)]
            if expected and absent:
                missing.append(f"{' and '.join(absent)} on {topic}")
            elif expected and self._found.get(topic, 0) < len(present):
                missing.append(f"the publisher of {topic}, which must find its subscribers")
        return missing
