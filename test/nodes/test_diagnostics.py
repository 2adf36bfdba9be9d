# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import time
from collections import Counter

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, Stream
from vislam_ros.data.bags.layout import DIAGNOSTICS, Topic
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions, diagnostics
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.topics import STREAM

WORDS = Topic("words", "std_msgs/msg/String", stream=Stream.TWIST)


class Monitored(Node):
    def __init__(self, **options):
        super().__init__("monitored", **options)
        self.warning = None
        self.monitor = Monitor(self, lambda: ("running", {"own value": 1.5}), lambda: self.warning)


@pytest.fixture
def node(make_node):
    return make_node(Monitored)


@pytest.fixture
def spin_until(node, context):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin(condition):
        deadline = time.monotonic() + 20
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)

    yield spin
    executor.shutdown()


def last_report(published):
    message = published[DIAGNOSTICS.name][-1]
    return message.status[0], conversions.status_values(message, "/monitored")


def test_a_callback_that_fails_is_counted_and_the_next_message_is_heard(node, spin_until):
    heard = []

    def fail_at_first(message):
        heard.append(message.data)
        if len(heard) == 1:
            raise RuntimeError("unforeseen")

    node.monitor.subscribe(WORDS, fail_at_first)
    publisher = node.create_publisher(String, WORDS.name, STREAM)
    spin_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="a"))
    publisher.publish(String(data="b"))
    spin_until(lambda: len(heard) == 2)
    assert heard == ["a", "b"]
    assert node.monitor.refused.counts == {"internal_error": 1}


def test_bytes_that_are_no_message_are_counted_under_their_stream(node):
    heard = []
    node.monitor.subscribe(WORDS, heard.append)
    node.monitor.take(WORDS, b"\x00\x01\x00\x00junk")
    node.monitor.take(WORDS, serialize_message(String(data="a")))
    assert [message.data for message in heard] == ["a"]
    assert node.monitor.refused.counts == {"twist_undecodable": 1}


def test_bytes_that_are_no_message_cost_a_live_node_only_themselves(node, spin_until):
    """They come over the wire, as a player sends what stands in a bag."""
    heard = []
    node.monitor.subscribe(WORDS, heard.append)
    publisher = node.create_publisher(String, WORDS.name, STREAM)
    spin_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(b"\x00\x01\x00\x00junk")
    publisher.publish(String(data="a"))
    spin_until(lambda: heard)
    assert node.monitor.refused.counts == {"twist_undecodable": 1}


def test_what_came_is_told_as_soon_as_it_pauses(node, capture, spin_until, monkeypatch):
    monkeypatch.setattr(diagnostics, "PERIOD", 3600.0)
    published = capture(node)
    node.monitor.subscribe(WORDS, lambda _: None)
    for _ in range(3):
        node.monitor.take(WORDS, serialize_message(String(data="a")))
    spin_until(lambda: published[DIAGNOSTICS.name])
    assert last_report(published)[1]["received words"] == "3"


def test_reports_give_rise_to_no_reports(node, capture, monkeypatch):
    monkeypatch.setattr(diagnostics, "PERIOD", 3600.0)
    published = capture(node)
    node.monitor.subscribe(DIAGNOSTICS, lambda _: None)
    node.monitor.report()
    for _ in range(5):
        node.monitor.take(DIAGNOSTICS, serialize_message(published[DIAGNOSTICS.name][-1]))
        node.monitor._check()
        node.monitor._check()
    assert len(published[DIAGNOSTICS.name]) == 1


def test_a_service_that_fails_answers_so(node, spin_until):
    def fail():
        raise VislamError("not now")

    node.monitor.serve("~/fail", fail)
    node.monitor.serve("~/work", lambda: "done")
    answers = {}
    for name in ("fail", "work"):
        client = node.create_client(Trigger, f"monitored/{name}")
        spin_until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        spin_until(future.done)
        answers[name] = (future.result().success, future.result().message)
    assert answers == {"fail": (False, "not now"), "work": (True, "done")}


def test_counts_of_the_core_are_taken_over_once(node):
    refused = RefusalCounts(Counter(twist_late=2), {"twist_late": 7})
    node.monitor.absorb("core", refused)
    node.monitor.absorb("core", refused)
    refused.counts["twist_late"] += 1
    node.monitor.absorb("core", refused)
    node.monitor.absorb("other", RefusalCounts(Counter(twist_late=1), {"twist_late": 3}))
    assert node.monitor.refused == RefusalCounts(Counter(twist_late=4), {"twist_late": 7})


def test_each_reason_is_logged_at_once_and_then_ever_more_rarely(node, monkeypatch):
    lines = []
    logger = node.get_logger()
    monkeypatch.setattr(logger, "warning", lambda line: lines.append(line))
    for _ in range(1000):
        node.monitor.refuse(Refusal.LATE, "by a lot")
    node.monitor.refuse(Refusal.DUPLICATE, stream=Stream.TWIST)
    assert len(lines) == 5
    assert lines[0] == "refused 1 message(s) so far as late: by a lot"
    assert lines[-1].endswith("as twist_duplicate: there was one with the same stamp")


def test_a_report_warns_of_what_was_refused_since_the_last(node, capture):
    published = capture(node)
    node.monitor.refuse(Refusal.LATE, stream=Stream.TWIST, stamp=2_500_000_000)
    node.monitor.report()
    status, values = last_report(published)
    assert status.level == b"\x01"
    assert values["refused twist_late"] == "1"
    assert values["first twist_late [s]"] == "2.500000000"
    assert values["own value"] == "1.5"
    node.monitor.report()
    status, values = last_report(published)
    assert (status.level, status.message) == (b"\x00", "running")
    assert values["refused twist_late"] == "1"


def test_a_report_warns_for_as_long_as_something_is_wrong(node, capture):
    published = capture(node)
    node.warning = "the lamp is out"
    node.monitor.refuse(Refusal.LATE, stream=Stream.TWIST)
    node.monitor.report()
    status, _ = last_report(published)
    assert status.level == b"\x01"
    assert status.message == "running; the lamp is out; 1 message(s) refused"
    node.monitor.report()
    status, _ = last_report(published)
    assert (status.level, status.message) == (b"\x01", "running; the lamp is out")
    node.warning = None
    node.monitor.report()
    status, _ = last_report(published)
    assert (status.level, status.message) == (b"\x00", "running")


def test_a_new_subscriber_is_reported(node, capture, spin_until):
    published = capture(node)
    node.monitor.advertise(WORDS)
    node.create_subscription(String, WORDS.name, lambda _: None, STREAM)

    def is_reported():
        return bool(published[DIAGNOSTICS.name]) and (
            last_report(published)[1].get("subscribers words") == "1"
        )

    spin_until(is_reported)


def test_a_message_that_cannot_be_published_costs_only_itself(node):
    class Blocked:
        topic_name = "/blocked"

        def publish(self, message):
            raise RuntimeError("time-out")

    node.monitor.publish(Blocked(), String())
    assert node.monitor.refused.counts == {"not_published": 1}
