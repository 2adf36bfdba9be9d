# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics in rclpy's terms: the class of their messages and their quality of service.

Both are declared in :mod:`vislam_ros.data.bags.layout`. KEEP_LAST loses messages whenever a
publisher outruns its subscriber, reliable or not; KEEP_ALL makes the publisher wait.
"""

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rosbags.interfaces import Qos

from vislam_ros.data.bags.layout import LATCHED_QOS, STREAM_QOS, TRANSFORMS
from vislam_ros.errors import SettingsError
from vislam_ros.nodes.made_types.list_message import list_message_class


def qos_profile(qos: Qos) -> QoSProfile:
    """Profile of a quality of service without deadline, lifespan and lease."""
    return QoSProfile(
        history=HistoryPolicy[qos.history.name],
        depth=qos.depth,
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


STREAM, LATCHED = qos_profile(STREAM_QOS), qos_profile(LATCHED_QOS)


@contextmanager
def qos_overrides(name: str) -> Iterator[QoSOverridingOptions]:
    """Let the parameters ``qos_overrides./TOPIC...`` change the profile of what is made inside.

    Raises
    ------
    SettingsError
        Where one of them will not do, with the topic's name.
    """
    policies = (
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what _has_depth says better
            yield QoSOverridingOptions(policies, callback=_has_depth)
    except (ParameterException, InvalidQosOverridesError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "QoS override" not in str(error):
            raise
        reason = str(error).splitlines()[0]
        raise SettingsError(f"qos_overrides of {name}: {reason}") from error


def _has_depth(profile: QoSProfile) -> SetParametersResult:
    # rclpy itself would take another depth.
    if profile.history is HistoryPolicy.KEEP_LAST and not profile.depth:
        return SetParametersResult(successful=False, reason="keep_last needs a depth")
    return SetParametersResult(successful=True)


def message_class(msgtype: str) -> Any:
    """Class of a message type such as ``sensor_msgs/msg/Imu``; None where it is not installed.

    The one of transforms is made where its package is missing: it sends CDR bytes alone.
    """
    package, _, name = msgtype.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        if msgtype == TRANSFORMS.msgtype:
            return list_message_class(msgtype, "transforms", TransformStamped)
        return None
