# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that hear ordinary sources: reliably where these can be, else as they send.

A reliable subscription loses nothing and hears no best-effort publisher; one that asks for the
latched message hears no volatile publisher. BEST_AVAILABLE knows only the publishers that are
there before it. So where no publisher of a topic fits, a second subscription is opened that fits
them all. As soon as one fits the first, that is heard alone: nothing comes twice.
"""

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from vislam_ros.data.bags.layout import Topic
from vislam_ros.nodes.topics import message_class, qos_overrides, qos_profile

# As rclpy has it for nodes that it has not heard of yet, and for other programs.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"


def is_named(end: TopicEndpointInfo) -> bool:
    """Whether it is known whose end of a topic this is; an end may be found before its node is."""
    return bool(end.node_name != _UNKNOWN)


def mismatch(offered: QoSProfile, wanted: QoSProfile) -> str:
    """Policies that keep a publisher from a subscription, in words; empty where it is heard.

    The topics of this package have no deadlines, no lifespans and no leases.
    """
    policies = []
    if (
        wanted.reliability is ReliabilityPolicy.RELIABLE
        and offered.reliability is ReliabilityPolicy.BEST_EFFORT
    ):
        policies.append("reliability best_effort, not reliable")
    if (
        wanted.durability is DurabilityPolicy.TRANSIENT_LOCAL
        and offered.durability is DurabilityPolicy.VOLATILE
    ):
        policies.append("durability volatile, not transient_local")
    return " and ".join(policies)


def fitting(offered: Iterable[QoSProfile], wanted: QoSProfile) -> QoSProfile:
    """Profile that hears each of some publishers and is otherwise as wanted."""
    reliability, durability = wanted.reliability, wanted.durability
    for one in offered:
        if one.reliability is ReliabilityPolicy.BEST_EFFORT:
            reliability = ReliabilityPolicy.BEST_EFFORT
        if one.durability is DurabilityPolicy.VOLATILE:
            durability = DurabilityPolicy.VOLATILE
    return QoSProfile(
        history=wanted.history, depth=wanted.depth, reliability=reliability, durability=durability
    )


class MatchingSubscription:
    """Hears a topic from whoever publishes it, as CDR bytes.

    Parameters
    ----------
    node : Node
    topic : Topic
    callback : callable
        Called with the bytes of each message.

    Raises
    ------
    SettingsError
        Where an override of the quality of service is none.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        callback: Callable[[bytes], None],
    ):
        self._node = node
        self._topic = topic
        self._callback = callback
        self._second: Subscription | None = None
        with qos_overrides(topic.name) as overrides:
            self._first = self._open(qos_profile(topic.qos), callback, overrides)

    def _open(
        self,
        profile: QoSProfile,
        callback: Callable[[bytes], None],
        overrides: QoSOverridingOptions | None = None,
    ) -> Subscription:
        return self._node.create_subscription(
            message_class(self._topic.msgtype),
            self._topic.name,
            callback,
            profile,
            raw=True,
            qos_overriding_options=overrides,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._on_event,
                matched=self._on_event,
                use_default_callbacks=False,
            ),
        )

    def _on_event(self, _event: Any) -> None:
        self.look()

    def _hear_second(self, data: bytes) -> None:
        # What fits the first one is heard there, though this one may not be closed yet.
        if not self._first.get_publisher_count():
            self._callback(data)

    def look(self) -> None:
        """Look who publishes now, and listen so that it is heard."""
        if self._first.get_publisher_count():
            self._close_second()
            return
        offered = [publisher.qos_profile for publisher in self._publishers()]
        if not offered:
            return
        profile = fitting(offered, self._first.qos_profile)
        if not mismatch(profile, self._first.qos_profile):
            return  # all fit the first one, which has yet to match them
        if self._second is None or any(mismatch(one, self._second.qos_profile) for one in offered):
            self._close_second()
            self._second = self._open(profile, self._hear_second)
            logger = self._node.get_logger()
            logger.info(f"{self._topic.name} is heard as it is sent: {self.heard_as()}")

    def _close_second(self) -> None:
        if self._second is not None:
            self._node.destroy_subscription(self._second)
            self._second = None

    def _publishers(self) -> list[TopicEndpointInfo]:
        publishers = self._node.get_publishers_info_by_topic(self._topic.name)
        return [one for one in publishers if one.topic_type == self._topic.msgtype]

    def heard_as(self) -> str:
        """Say how publishers are heard that do not fit, in words; empty where all fit."""
        if self._second is None:
            return ""
        return mismatch(self._second.qos_profile, self._first.qos_profile)

    def unheard(self) -> list[str]:
        """Publishers that are not heard, each in words, with what keeps them from it."""
        listening = (self._second or self._first).qos_profile
        unheard = []
        for one in self._node.get_publishers_info_by_topic(self._topic.name):
            if one.topic_type != self._topic.msgtype:
                reason = f"type {one.topic_type}, not {self._topic.msgtype}"
            else:
                reason = mismatch(one.qos_profile, listening)
            if reason:
                name = f"{one.node_namespace.rstrip('/')}/{one.node_name}"
                name = name if is_named(one) else "a publisher"
                unheard.append(f"{name} on {self._topic.name} ({reason})")
        return unheard
