# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a player sends the topics of a bag: their publishers, and who takes what they send."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher

from vislam_ros.data.bags.bag_messages import BagConnection
from vislam_ros.data.bags.layout import (
    CLOCK,
    DIAGNOSTICS,
    IMAGES,
    LATCHED_QOS,
    ODOMETRY,
    PLAYER,
    STREAM_QOS,
    TOPICS,
    Topic,
)
from vislam_ros.data.bags.naming import namespace_of, played_name
from vislam_ros.errors import VislamError
from vislam_ros.nodes.spin import ros_reason
from vislam_ros.nodes.topics import message_class, qos_overrides, qos_profile

# What the player itself publishes and hears.
_OF_PLAYER = (DIAGNOSTICS, ODOMETRY, PLAYER, CLOCK)


@dataclass
class Outlet:
    """A topic that is played.

    Attributes
    ----------
    publisher : Publisher
    latched : bool
        Whether those who come later get the last message.
    role : Topic or None
        Which topic of a drive it is.
    sent : int
        Messages that were sent.
    """

    publisher: Publisher
    latched: bool
    role: Topic | None = None
    sent: int = 0
    _unheard: int = 0

    @property
    def name(self) -> str:
        """Topic on which it is played."""
        return self.publisher.topic_name

    @property
    def subscribers(self) -> int:
        """How many have found it."""
        return self.publisher.get_subscription_count()

    def send(self, data: bytes) -> bool:
        """Publish; False where the history is full because a subscriber is slow."""
        heard = self.subscribers > 0
        try:
            self.publisher.publish(data)
        except RuntimeError:
            return False
        self.sent += 1
        self._unheard += not heard
        return True

    @property
    def untaken(self) -> int:
        """Messages that nobody took, so far."""
        return 0 if self.latched and self.subscribers else self._unheard


def make_outlets(
    node: Node,
    connections: Sequence[BagConnection],
    chosen: set[str],
    renamed: Mapping[str, str],
) -> dict[str, Outlet]:
    """Make the outlet of each chosen topic of a bag whose message type is installed.

    Parameters
    ----------
    node : Node
        Topics are put into its namespace, unless the bag has it (see
        :mod:`vislam_ros.data.bags.naming`).
    connections : sequence of BagConnection
    chosen : set of str
        Topics as the bag calls them.
    renamed : mapping of str to str
        Other names under which to play some of them.

    Raises
    ------
    VislamError
        Where a name is none, or two topics of different types would have the same.
    """
    recorded = [connection.topic for connection in connections]
    namespace = namespace_of(node.get_namespace())
    outlets = {}
    types = {node.resolve_topic_name(topic.name): topic.msgtype for topic in _OF_PLAYER}
    for connection in sorted(connections, key=lambda connection: connection.topic):
        topic = connection.topic
        if topic not in chosen:
            continue
        cls = message_class(connection.msgtype)
        if cls is None:
            node.get_logger().warning(
                f"{topic} is not played: {connection.msgtype} is not installed"
            )
            continue
        name = renamed.get(topic) or played_name(topic, recorded, namespace)
        with _clear_errors(topic, name), qos_overrides(name) as overrides:
            _require_one_type(node.resolve_topic_name(name), connection, types)
            publisher = node.create_publisher(
                cls,
                name,
                qos_profile(LATCHED_QOS if connection.latched else STREAM_QOS),
                qos_overriding_options=overrides,
                # Who does not fit may open another subscription that does, as our nodes do.
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
        outlets[topic] = Outlet(publisher, connection.latched)
    for role, topic in _roles(node, outlets, namespace):
        outlets[topic].role = role
    return outlets


def _require_one_type(name: str, connection: BagConnection, types: dict[str, str]) -> None:
    """Refuse to play topics of different types as one; ``types`` are those of names so far."""
    msgtype = types.setdefault(name, connection.msgtype)
    if msgtype != connection.msgtype:
        raise VislamError(
            f"{connection.topic}: is {connection.msgtype} and cannot be played as {name}, which "
            f"is {msgtype}: choose another name in --remap"
        )


@contextmanager
def _clear_errors(topic: str, name: str) -> Iterator[None]:
    try:
        yield
    except (NameValidationException, RuntimeError) as error:
        raise VislamError(
            f"{topic}: cannot be played as {name}: {ros_reason(error)}: see --remap"
        ) from error


def sought_by(node: Node, outlets: Iterable[Outlet | None]) -> list[str]:
    """Say of which outlets the graph has subscribers that have not found them yet."""
    return [
        f"all subscribers of {outlet.name}"
        for outlet in outlets
        if outlet is not None and outlet.subscribers < node.count_subscribers(outlet.name)
    ]


def _roles(
    node: Node, outlets: Mapping[str, Outlet], namespace: str
) -> Iterator[tuple[Topic, str]]:
    """Yield each topic of a drive that is played, and what the bag calls it.

    That is the one that is played under its name, or else the one that the bag has under it: the
    nodes may be told, as the player was, to use another.
    """
    by_name = {outlet.name: topic for topic, outlet in outlets.items()}
    for role in (*TOPICS, *IMAGES):
        played = by_name.get(node.resolve_topic_name(role.name))
        own = next((t for t in (namespace + role.recorded, role.recorded) if t in outlets), None)
        if topic := played or own:
            yield role, topic


def split_rules(
    rules: Iterable[str], connections: Iterable[BagConnection]
) -> tuple[dict[str, str], list[str]]:
    """Rules for topics of a bag, by its names, and the arguments of those for the player."""
    recorded = {connection.topic for connection in connections}
    renamed, others = {}, []
    for rule in rules:
        source, _, target = rule.partition(":=")
        name = f"/{source.lstrip('/')}"
        if name in recorded:
            renamed[name] = target
        else:
            others += ["-r", rule]
    return renamed, others
