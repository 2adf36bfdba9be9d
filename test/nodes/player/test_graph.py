# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Somebody who is found before it is known who it is counts as there, and is waited for."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from vislam_ros.data.bags.layout import FEATURES, ODOMETRY, PREDICTION
from vislam_ros.nodes.player.graph import GraphWatch
from vislam_ros.nodes.player.window import FeatureWindow
from vislam_ros.nodes.topics import STREAM

UNKNOWN = "_NODE_NAME_UNKNOWN_"


@pytest.fixture
def watch(make_node, monkeypatch):
    """Watch of a graph whose ends are known by name, or not, as ``hidden`` says; and that set."""
    node = make_node(lambda **options: Node("watcher", **options))
    slam = make_node(lambda **options: Node("slam_node", **options))
    slam.create_subscription(PointCloud2, FEATURES.name, print, STREAM)
    slam.create_subscription(Odometry, PREDICTION.name, print, STREAM)
    slam.create_publisher(Odometry, ODOMETRY.name, STREAM)
    hidden = set()
    for kind in ("publishers", "subscriptions"):
        asked = f"get_{kind}_info_by_topic"
        ask = getattr(node, asked)

        def told(topic, ask=ask):
            infos = ask(topic)
            for info in infos:
                if topic in hidden:
                    info.node_name = UNKNOWN
            return infos

        monkeypatch.setattr(node, asked, told)
    return GraphWatch(node, FeatureWindow(None)), hidden


def report(watch):
    values = [KeyValue(key="subscribers slam/odometry", value="0")]
    status = DiagnosticStatus(name="/slam_node", values=values)
    watch._on_diagnostics(DiagnosticArray(status=[status]))


@pytest.mark.parametrize("topic", [FEATURES.name, PREDICTION.name, ODOMETRY.name])
def test_an_end_without_a_name_is_waited_for(watch, topic):
    graph, hidden = watch
    assert graph.missing(whole=False) == []
    hidden.add(topic)
    assert graph.missing(whole=False) == [f"the name of a node on {topic}"]
    hidden.clear()
    assert graph.missing(whole=False) == []


def test_a_node_of_which_no_end_has_a_name_is_not_taken_for_absent(watch):
    graph, hidden = watch
    assert graph.silent() == ["slam_node"]
    hidden |= {FEATURES.name, PREDICTION.name, ODOMETRY.name}
    assert graph.silent() == []
    assert len(graph.missing(whole=False)) == 3, "so this holds the player"
    hidden.remove(ODOMETRY.name)
    assert graph.silent() == ["slam_node"], "by the one end that is known"
    report(graph)
    assert graph.silent() == []


@pytest.mark.parametrize(
    "wrong", [{"subscribers slam/odometry": "many"}, {"received imu/twist": "1.5"}]
)
def test_a_status_of_somebody_else_under_a_nodes_name_is_passed_over(watch, wrong):
    graph, _ = watch
    values = [KeyValue(key=key, value=value) for key, value in wrong.items()]
    status = DiagnosticStatus(name="/slam_node", values=values)
    graph._on_diagnostics(DiagnosticArray(status=[status]))
    assert graph.silent() == ["slam_node"]
    report(graph)
    assert graph.silent() == []
