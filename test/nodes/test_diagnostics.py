# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import time
from collections import Counter

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.qos import STREAM


class Monitored(Node):
    def __init__(self, **options):
        super().__init__("monitored", **options)
        self.monitor = Monitor(self, lambda: ("running", {"own value": 1.5}))


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
    message = published["/diagnostics"][-1]
    return message.status[0], conversions.status_values(message, "/monitored")


def test_a_callback_that_fails_is_counted_and_the_next_message_is_heard(node, spin_until):
    heard = []

    def fail_at_first(message):
        heard.append(message.data)
        if len(heard) == 1:
            raise RuntimeError("unforeseen")

    node.monitor.subscribe(String, "words", fail_at_first)
    publisher = node.create_publisher(String, "words", STREAM)
    spin_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="a"))
    publisher.publish(String(data="b"))
    spin_until(lambda: len(heard) == 2)
    assert heard == ["a", "b"]
    assert node.monitor.refused == {"internal_error": 1}


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
    refused = Counter(late=2)
    node.monitor.absorb("core", refused)
    node.monitor.absorb("core", refused)
    refused["late"] += 1
    node.monitor.absorb("core", refused)
    node.monitor.absorb("other", Counter(late=1))
    assert node.monitor.refused == {"late": 4}


def test_each_reason_is_logged_at_once_and_then_ever_more_rarely(node, monkeypatch):
    lines = []
    logger = node.get_logger()
    monkeypatch.setattr(logger, "warning", lambda line: lines.append(line))
    for _ in range(1000):
        node.monitor.refuse("late", "by a lot")
    node.monitor.refuse("duplicate")
    assert len(lines) == 5
    assert lines[0] == "refused 1 message(s) so far as late: by a lot"


def test_a_report_warns_of_what_was_refused_since_the_last(node, capture):
    published = capture(node)
    node.monitor.refuse("late")
    node.monitor.report()
    status, values = last_report(published)
    assert status.level == b"\x01"
    assert values["refused late"] == "1"
    assert values["own value"] == "1.5"
    node.monitor.report()
    status, values = last_report(published)
    assert (status.level, status.message) == (b"\x00", "running")
    assert values["refused late"] == "1"


def test_a_new_subscriber_is_reported(node, capture, spin_until):
    published = capture(node)
    node.monitor.advertise(String, "words")
    node.create_subscription(String, "words", lambda _: None, STREAM)

    def is_reported():
        return bool(published["/diagnostics"]) and (
            last_report(published)[1].get("subscribers words") == "1"
        )

    spin_until(is_reported)


def test_a_message_that_cannot_be_published_costs_only_itself(node):
    class Blocked:
        topic_name = "/blocked"

        def publish(self, message):
            raise RuntimeError("time-out")

    node.monitor.publish(Blocked(), String())
    assert node.monitor.refused == {"not_published": 1}
