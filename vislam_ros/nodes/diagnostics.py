# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a node counts and reports: messages received and refused, by reason, on /diagnostics."""

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.conversions import MessageError
from vislam_ros.nodes.qos import STREAM

PERIOD = 1.0
"""Seconds of the clock between two messages on /diagnostics."""

_CHECK_PERIOD = 0.2


class Monitor:
    """Keeps a node alive whatever it is sent, and says on /diagnostics what that was.

    Parameters
    ----------
    node : Node
    describe : callable
        Gives, for the next report, what the node is doing in a few words and its own values.

    Attributes
    ----------
    refused : Counter of str
        Messages that were not used, by reason.
    """

    def __init__(self, node: Node, describe: Callable[[], tuple[str, Mapping[str, object]]]):
        self._node = node
        self._describe = describe
        self._received: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self._absorbed: dict[str, Counter[str]] = {}
        self._last_report = time.monotonic()
        self._last_received = self._received.copy()
        self._last_refused = 0
        self._outputs: dict[str, Publisher] = {}
        self._subscribers: dict[str, int] = {}
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
        self._timer = node.create_timer(_CHECK_PERIOD, self.guard("diagnostics", self._check))

    def advertise(self, message_type: type, topic: str, qos: QoSProfile = STREAM) -> Publisher:
        """Create a publisher whose number of subscribers is reported as soon as it changes."""
        self._outputs[topic] = self._node.create_publisher(message_type, topic, qos)
        return self._outputs[topic]

    def subscribe(
        self, message_type: type, topic: str, callback: Callable[[Any], None], **options: Any
    ) -> None:
        """Subscribe with a callback that no message can make fail."""
        options.setdefault("qos_profile", STREAM)
        guarded = self.guard(topic, callback)

        def on_message(message: Any) -> None:
            self._received[topic] += 1
            guarded(message)

        self._node.create_subscription(message_type, topic, on_message, **options)

    def guard(self, name: str, callback: Callable[..., None]) -> Callable[..., None]:
        """Wrap a callback so that its errors are counted and logged, and go no further."""

        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except MessageError as error:
                self.refuse(error.reason, str(error))
            except VislamError as error:
                self.refuse("error", str(error))
            except Exception:
                if self._node.context.ok():
                    self.refuse("internal_error", f"{name}: {traceback.format_exc()}")

        return guarded

    def serve(self, name: str, handler: Callable[[], str]) -> None:
        """Offer a Trigger service; the handler returns its message or raises a VislamError."""

        def on_request(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = handler(), True
            except VislamError as error:
                response.message, response.success = str(error), False
            except Exception as error:
                response.message, response.success = f"internal error: {error!r}", False
                self.refuse("internal_error", f"{name}: {traceback.format_exc()}")
            return response

        self._node.create_service(Trigger, name, on_request)

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Publish; a subscriber that blocks the writer costs it this message, not the node."""
        try:
            publisher.publish(message)
        except RuntimeError as error:
            if self._node.context.ok():
                self.refuse("not_published", f"{publisher.topic_name}: {error}")

    def refuse(self, reason: str, detail: str = "") -> None:
        """Count a refused message; log the first of a reason, then the 10th, the 100th, ..."""
        self._add(reason, 1, detail)

    def absorb(self, source: str, refused: Counter[str]) -> None:
        """Take over what a part of the core, known by a name, has counted since the last call."""
        absorbed = self._absorbed.setdefault(source, Counter())
        if refused != absorbed:
            for reason, more in (refused - absorbed).items():
                self._add(reason, more, "")
            self._absorbed[source] = refused.copy()

    def _add(self, reason: str, count: int, detail: str) -> None:
        before = self.refused[reason]
        self.refused[reason] += count
        if len(str(before)) < len(str(before + count)) or before == 0:
            detail = f": {detail}" if detail else ""
            self._node.get_logger().warning(
                f"refused {before + count} message(s) so far as {reason}{detail}"
            )

    def _check(self) -> None:
        subscribers = self._count_subscribers()
        elapsed = time.monotonic() - self._last_report
        if elapsed >= PERIOD or subscribers != self._subscribers:
            self.report()

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
        message, own_values = self._describe()
        values.update(own_values)
        self._subscribers = self._count_subscribers()
        values.update({f"subscribers {topic}": n for topic, n in self._subscribers.items()})
        values.update({f"refused {reason}": n for reason, n in sorted(self.refused.items())})
        status = conversions.status(self._node.get_fully_qualified_name(), values)
        total = self.refused.total()
        newly_refused = total - self._last_refused
        status.level = DiagnosticStatus.WARN if newly_refused else DiagnosticStatus.OK
        status.message = (
            f"{message}; {newly_refused} message(s) refused" if newly_refused else message
        )
        stamp = self._node.get_clock().now().to_msg()
        self.publish(self._publisher, conversions.status_array(stamp, [status]))
        self._last_report, self._last_refused = now, total
        self._last_received = self._received.copy()


def stamp_age(node: Node, stamp: int) -> float:
    """Seconds by which the node's clock is ahead of a stamp (ns)."""
    return (node.get_clock().now().nanoseconds - stamp) * 1e-9
