# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import functools
import threading
import time
from typing import Any

import pytest
from live.node_processes import wait_until
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import Empty

from vislam_ros.nodes import spin
from vislam_ros.nodes.spin import spinning

WAIT = 10.0


# The latter where rclpy is older than 7.1.4.
both_executors = pytest.mark.parametrize("executor", [EventsExecutor, SingleThreadedExecutor])


@both_executors
def test_a_thread_answers_until_the_block_ends(
    context: Context, monkeypatch: pytest.MonkeyPatch, executor: Any
) -> None:
    monkeypatch.setattr(spin, "EventsExecutor", executor)
    node = Node("spun", context=context)
    heard = threading.Event()
    node.create_subscription(Empty, "said", lambda _: heard.set(), 1)
    publisher = node.create_publisher(Empty, "said", 1)
    before = threading.active_count()
    with spinning(node):
        publisher.publish(Empty())
        assert heard.wait(WAIT)
    assert threading.active_count() == before
    node.destroy_node()


@both_executors
def test_what_comes_for_a_subscription_that_is_gone_by_then_ends_nothing(
    context: Context, monkeypatch: pytest.MonkeyPatch, executor: Any
) -> None:
    monkeypatch.setattr(spin, "EventsExecutor", executor)
    node = Node("spun", context=context)
    heard: list[str] = []
    matched = SubscriptionEventCallbacks(matched=lambda _: None)
    short_lived = [
        node.create_subscription(Empty, "short", lambda _: None, 1, event_callbacks=matched)
    ]
    publisher = node.create_publisher(Empty, "said", 1)

    def hear(_: Empty) -> None:
        if short_lived:
            node.create_publisher(Empty, "short", 1).publish(Empty())
            subscription = short_lived.pop()
            end = time.monotonic() + WAIT
            while not subscription.get_publisher_count() and time.monotonic() < end:
                time.sleep(0.01)
            node.destroy_subscription(subscription)
        heard.append("said")

    def has_heard(times: int) -> bool:
        return len(heard) == times

    node.create_subscription(Empty, "said", hear, 1)
    with spinning(node):
        for number in (1, 2):
            publisher.publish(Empty())
            wait_until(functools.partial(has_heard, number), "the answer")
    node.destroy_node()
