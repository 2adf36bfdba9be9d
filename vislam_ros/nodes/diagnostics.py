# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a node counts and reports: messages received and refused, by reason, on /diagnostics."""

import functools
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from vislam_ros.core.tracking.refusals import (
    Refusal,
    RefusalCounts,
    RefusedMessage,
    Stream,
    refusal_of,
)
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.encoding import jazzy_types
from vislam_ros.data.bags.layout import DIAGNOSTICS, TRANSFORMS, Topic
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.errors import OutputError, VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.steady import steady_timer
from vislam_ros.nodes.subscribing import MatchingSubscription
from vislam_ros.nodes.topics import message_class, qos_overrides, qos_profile

PERIOD = 1.0
"""Seconds of the clock between two messages on /diagnostics; fewer where something changes."""

_CHECK_PERIOD = 0.2


class Monitor:
    """Keeps a node alive whatever it is sent, and says on /diagnostics what that was.

    Only an :class:`OutputError` is kept: a node that cannot write any more has to end.

    Parameters
    ----------
    node : Node
    describe : callable
        Gives, for the next report, what the node is doing in a few words and its own values.
    warn : callable, optional
        Tells what is wrong, if anything is; asked just before ``describe``.

    Attributes
    ----------
    refused : RefusalCounts
        Messages that were not used.
    failure : OutputError or None
        What keeps the node from going on; whoever spins it ends it.
    """

    def __init__(
        self,
        node: Node,
        describe: Callable[[], tuple[str, Mapping[str, object]]],
        warn: Callable[[], str | None] = lambda: None,
    ):
        self._node = node
        self._describe = describe
        self._warn = warn
        self._callbacks: dict[str, Callable[..., None]] = {}
        self._classes: dict[str, Any] = {}
        self._received: Counter[str] = Counter()
        self.refused = RefusalCounts()
        self.failure: OutputError | None = None
        self._uncounted = {DIAGNOSTICS.name}
        self._absorbed: dict[str, Counter[str]] = {}
        self._last_report = time.monotonic()
        self._last_received = self._received.copy()
        self._last_refused = 0
        self._seen = self._reported_inputs = 0
        self._outputs: dict[str, Publisher] = {}
        self._subscribers: dict[str, int] = {}
        self._inputs: dict[str, MatchingSubscription] = {}
        self._unheard: list[str] = []
        self._publisher = self._create_publisher(DIAGNOSTICS)
        steady_timer(node, _CHECK_PERIOD, self.guard("diagnostics", self._check))

    def _create_publisher(self, topic: Topic) -> Publisher:
        with qos_overrides(topic.name) as overrides:
            return self._node.create_publisher(
                message_class(topic.msgtype),
                topic.name,
                qos_profile(topic.qos),
                qos_overriding_options=overrides,
            )

    @property
    def inputs(self) -> int:
        """Messages that came, without those that are not counted.

        These are the nodes' reports, which would give rise to others.
        """
        return self._received.total() - sum(self._received[name] for name in self._uncounted)

    def advertise(self, topic: Topic) -> Publisher:
        """Create a publisher whose number of subscribers is reported as soon as it changes."""
        self._outputs[topic.name] = self._create_publisher(topic)
        return self._outputs[topic.name]

    def subscribe(
        self,
        topic: Topic,
        callback: Callable[..., None],
        *,
        with_data: bool = False,
        counted: bool = True,
    ) -> None:
        """Subscribe with a callback that no message can make fail.

        Messages come as bytes and are decoded here, so that those that cannot be are counted.

        Parameters
        ----------
        topic : Topic
        callback : callable
            Called with the message and, ``with_data``, with its CDR bytes.
        with_data : bool
            As who records wants it.
        counted : bool
            Whether its messages are :attr:`inputs`; what is repeated for ever is none.
        """
        if not counted:
            self._uncounted.add(topic.name)
        self._received[topic.name] = 0
        self._classes[topic.name] = message_class(topic.msgtype)
        self._callbacks[topic.name] = callback if with_data else lambda msg, _data: callback(msg)
        self._inputs[topic.name] = MatchingSubscription(
            self._node, topic, functools.partial(self.take, topic)
        )

    def take(self, topic: Topic, data: bytes) -> None:
        """Take the CDR bytes of a message of a topic that is subscribed to."""
        self._received[topic.name] += 1
        message = None
        try:
            message = _decoded(topic, self._classes[topic.name], data)
            self._callbacks[topic.name](message, data)
        except RefusedMessage as error:
            stamp = decoding.stamp_if_known(message)
            self.refuse(error.refusal, str(error), topic.stream, stamp)
        except Exception as error:
            self._fail(topic.name, error)

    def guard(self, name: str, callback: Callable[..., None]) -> Callable[..., None]:
        """Wrap a callback so that its errors are counted and logged, and go no further."""

        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self._fail(name, error)

        return guarded

    def _fail(self, name: str, error: Exception) -> None:
        """Count and log an exception at hand, unless it is the end or comes from it."""
        if isinstance(error, OutputError):
            self.failure = error
        elif self._node.context.ok():
            what = error if isinstance(error, VislamError) else traceback.format_exc()
            self.refuse(Refusal.INTERNAL_ERROR, f"{name}: {what}")

    def serve(self, name: str, handler: Callable[[], str]) -> None:
        """Offer a Trigger service; the handler returns its message or raises a VislamError."""

        def on_request(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = handler(), True
            except VislamError as error:
                response.message, response.success = str(error), False
                if isinstance(error, OutputError):
                    self.failure = error
            except Exception as error:
                response.message, response.success = f"internal error: {error!r}", False
                self.refuse(Refusal.INTERNAL_ERROR, f"{name}: {traceback.format_exc()}")
            return response

        self._node.create_service(Trigger, name, on_request)

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Publish; a subscriber that blocks the writer costs it this message, not the node."""
        try:
            publisher.publish(message)
        except RuntimeError as error:
            if self._node.context.ok():
                self.refuse(Refusal.NOT_PUBLISHED, f"{publisher.topic_name}: {error}")

    def refuse(
        self,
        refusal: Refusal,
        detail: str = "",
        stream: Stream | None = None,
        stamp: int | None = None,
    ) -> None:
        """Count a refused message; log the first of a reason, then the 10th, the 100th, ..."""
        counts = RefusalCounts()
        counts.add(stream, refusal, stamp)
        self._merge(counts, detail)

    def absorb(self, source: str, refused: RefusalCounts) -> None:
        """Take over what a part of the core, known by a name, has counted since the last call."""
        absorbed = self._absorbed.setdefault(source, Counter())
        if refused.counts != absorbed:
            news = RefusalCounts(refused.counts - absorbed, refused.first_stamps)
            self._absorbed[source] = refused.counts.copy()
            self._merge(news, "")

    def _merge(self, news: RefusalCounts, detail: str) -> None:
        before = self.refused.counts.copy()
        self.refused.merge(news)
        for word in news.counts:
            count = self.refused.counts[word]
            if is_told(before[word], count):
                reason = detail or refusal_of(word).text
                self._node.get_logger().warning(
                    f"refused {count} message(s) so far as {word}: {reason}"
                )

    def _check(self) -> None:
        self._look()
        # What came up to a pause is told at once: somebody may be waiting for the last of it.
        pauses = self._reported_inputs != self.inputs == self._seen
        self._seen = self.inputs
        elapsed = time.monotonic() - self._last_report
        if elapsed >= PERIOD or pauses or self._count_subscribers() != self._subscribers:
            self.report()

    def _look(self) -> None:
        """Hear who publishes now; tell in the log of those who cannot be heard."""
        unheard = []
        for subscription in self._inputs.values():
            subscription.look()
            unheard.extend(subscription.unheard())
        for publisher in unheard:
            if publisher not in self._unheard:
                self._node.get_logger().warning(f"cannot hear {publisher}")
        self._unheard = unheard

    def _count_subscribers(self) -> dict[str, int]:
        return {
            topic: publisher.get_subscription_count() for topic, publisher in self._outputs.items()
        }

    def report(self) -> None:
        """Publish a diagnostic status."""
        now = time.monotonic()
        elapsed = max(now - self._last_report, 1e-9)
        values: dict[str, object] = {
            f"rate {topic} [Hz]": round((count - self._last_received[topic]) / elapsed, 3)
            for topic, count in self._received.items()
        }
        values.update({f"received {topic}": n for topic, n in self._received.items()})
        for topic, subscription in self._inputs.items():
            if heard_as := subscription.heard_as():
                values[f"heard {topic}"] = heard_as
        warning = self._warn()
        message, own_values = self._describe()
        values.update(own_values)
        self._subscribers = self._count_subscribers()
        values.update({f"subscribers {topic}": n for topic, n in self._subscribers.items()})
        values.update({f"refused {word}": n for word, n in sorted(self.refused.counts.items())})
        first_stamps = sorted(self.refused.first_stamps.items())
        values.update({f"first {word} [s]": stamp_text(stamp) for word, stamp in first_stamps})
        status = conversions.status(self._node.get_fully_qualified_name(), values)
        total = self.refused.counts.total()
        newly_refused = total - self._last_refused
        warnings = [warning] if warning else []
        warnings += [f"cannot hear {publisher}" for publisher in self._unheard]
        if newly_refused:
            warnings.append(f"{newly_refused} message(s) refused")
        status.level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
        status.message = "; ".join([message, *warnings])
        stamp = self._node.get_clock().now().to_msg()
        self.publish(self._publisher, conversions.status_array(stamp, [status]))
        self._last_report, self._last_refused = now, total
        self._last_received = self._received.copy()
        self._reported_inputs = self.inputs


def is_told(before: int, count: int) -> bool:
    """Whether a log tells of a count: the first, the 10th, the 100th, ... of a kind."""
    return len(str(before)) < len(str(count)) or before == 0


def _decoded(topic: Topic, message_type: Any, data: bytes) -> Any:
    try:
        if topic.msgtype == TRANSFORMS.msgtype:  # a class that was made decodes nothing
            return jazzy_types().deserialize_cdr(data, topic.msgtype)
        return deserialize_message(data, message_type)
    except Exception as error:  # rclpy has a class of its own for each way to fail
        raise RefusedMessage(Refusal.UNDECODABLE) from error


def values_if_over(over: RefusalCounts) -> dict[str, object]:
    """Values of a report on what will be refused if nothing more comes."""
    first_stamps = over.first_stamps.items()
    return {f"at end refused {word}": n for word, n in over.counts.items()} | {
        f"at end first {word} [s]": stamp_text(stamp) for word, stamp in first_stamps
    }


def stamp_age(node: Node, stamp: int) -> float:
    """Seconds by which the node's clock is ahead of a stamp (ns)."""
    return (node.get_clock().now().nanoseconds - stamp) * 1e-9


def neighbour(node: Node, name: str) -> str | None:
    """Name of a node that reports as ``name`` where it is in the same namespace as another.

    /diagnostics is one for all robots; None stands for a node of another one.
    """
    namespace, _, own = name.rpartition("/")
    return own if namespace == node.get_namespace().rstrip("/") else None
