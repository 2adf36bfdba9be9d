# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A camera that cannot be, and one that becomes another."""

import copy

import pytest
from rclpy.serialization import serialize_message

from vislam_ros.data.bags import layout
from vislam_ros.nodes.slam_node import SlamNode

ODOMETRY = layout.ODOMETRY.recorded


def send(node, topic, message):
    """Give a node a message as it comes from the wire."""
    node.monitor.take(topic, serialize_message(message))


@pytest.fixture
def node(make_node):
    return make_node(SlamNode)


def test_a_camera_that_is_no_pair_is_refused_and_a_right_one_taken(node, capture, drive):
    published = capture(node)
    good = copy.deepcopy(drive.right)
    drive.right.p[3] = 0.0
    for topic, message in drive.calibration:
        send(node, topic, message)
    for k in range(2):
        node.on_prediction(drive.predictions[k])
        node.on_features(drive.features[k])
    assert node.monitor.refused.counts == {"camera_info_not_a_pair": 1}
    assert not published[ODOMETRY]
    send(node, layout.RIGHT_CAMERA, good)
    assert len(published[ODOMETRY]) == 2


def test_a_calibration_that_changes_is_told_with_when_it_holds(node, capture, drive, capfd):
    published = capture(node)
    drive.calibrate(node)
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        node.on_prediction(prediction)
        node.on_features(features)
    nearer = copy.deepcopy(drive.extrinsics)
    nearer.transform.translation.x += 0.5
    for told, when in ((nearer, "the next pass or reset"), (drive.extrinsics, "the first frame")):
        capfd.readouterr()
        send(node, layout.EXTRINSICS, told)
        line = capfd.readouterr().err
        assert line.count(f"holds from {when} on") == 1
        assert line.count("position_body_camera: (") == 1
        send(node, layout.EXTRINSICS, told)
        assert "calibration changed" not in capfd.readouterr().err
        node.reset()
    assert len(published[ODOMETRY]) == len(drive.stamps)
