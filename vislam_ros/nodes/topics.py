# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics in rclpy's terms: the class of their messages and their quality of service.

Both are declared in :mod:`vislam_ros.data.bags.layout`. KEEP_LAST loses messages whenever a
publisher outruns its subscriber, reliable or not; KEEP_ALL makes the publisher wait.
"""

import importlib
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos

from vislam_ros.data.bags.layout import LATCHED_QOS, STREAM_QOS


def qos_profile(qos: Qos) -> QoSProfile:
    """Profile of a quality of service without deadline, lifespan and lease."""
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


STREAM, LATCHED = qos_profile(STREAM_QOS), qos_profile(LATCHED_QOS)


def message_class(msgtype: str) -> Any:
    """Class of a message type such as ``sensor_msgs/msg/Imu``; None where it is not installed."""
    package, _, name = msgtype.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        return None
