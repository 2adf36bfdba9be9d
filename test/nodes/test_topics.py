# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics in rclpy's terms are what the one declaration says."""

import pytest
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy
from sensor_msgs.msg import Imu

from vislam_ros.nodes.topics import LATCHED, STREAM, message_class


def test_every_message_of_a_stream_matters():
    assert STREAM.history is HistoryPolicy.KEEP_ALL
    assert STREAM.reliability is ReliabilityPolicy.RELIABLE
    assert STREAM.durability is DurabilityPolicy.VOLATILE


def test_a_latched_message_is_kept_for_those_who_come_later():
    assert (LATCHED.history, LATCHED.depth) == (HistoryPolicy.KEEP_LAST, 1)
    assert LATCHED.reliability is ReliabilityPolicy.RELIABLE
    assert LATCHED.durability is DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize(
    ("msgtype", "expected"),
    [("sensor_msgs/msg/Imu", Imu), ("sensor_msgs/msg/Sonar", None), ("no_msgs/msg/Imu", None)],
)
def test_a_class_is_found_where_it_is_installed(msgtype, expected):
    assert message_class(msgtype) is expected
