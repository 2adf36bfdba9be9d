# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import functools
import gc
import signal
import threading
from collections.abc import Callable
from typing import Any

import pytest
from live.node_processes import wait_until
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import Empty

from vislam_ros.errors import OutputError
from vislam_ros.nodes import spin
from vislam_ros.nodes.spin import spinning

WAIT = 10.0


# The latter where rclpy is older than 7.1.4.
@pytest.fixture(params=[EventsExecutor, SingleThreadedExecutor])
def executor(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nodes be spun by each in turn."""
    monkeypatch.setattr(spin, "EventsExecutor", request.param)


each_executor = pytest.mark.usefixtures("executor")


@each_executor
def test_a_thread_answers_until_the_block_ends(context: Context) -> None:
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


@each_executor
def test_a_thread_goes_on_after_what_a_callback_raises(context: Context) -> None:
    node = Node("spun", context=context)
    heard = []

    def hear(_: Empty) -> None:
        heard.append(True)
        raise ValueError("cannot be used")

    node.create_subscription(Empty, "said", hear, 1)
    publisher = node.create_publisher(Empty, "said", 1)
    with spinning(node):
        publisher.publish(Empty())
        wait_until(lambda: len(heard) == 1, "the message")
        publisher.publish(Empty())
        wait_until(lambda: len(heard) == 2, "the message after it")
    node.destroy_node()


class Raising(SingleThreadedExecutor):
    """Fails whenever it is spun, as a broken executor would, and sees how often it was."""

    spins = 0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        del timeout_sec
        Raising.spins += 1
        raise self.error

    error: Exception = ValueError("broken")


def test_a_node_ends_where_no_message_is_the_cause_of_what_its_executor_raises(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], domain_id: int
) -> None:
    monkeypatch.setattr(spin, "_LONGEST_SECONDS", 0.2)
    monkeypatch.setattr(spin, "EventsExecutor", Raising)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id))
    monkeypatch.setattr(Raising, "spins", 0)
    assert spun(monkeypatch) == 1
    assert capsys.readouterr().err.endswith("error: cannot go on: broken\n")
    assert Raising.spins > 1


def test_a_node_ends_at_once_where_it_cannot_write_any_more(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], domain_id: int
) -> None:
    monkeypatch.setattr(spin, "EventsExecutor", Raising)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id))
    monkeypatch.setattr(Raising, "spins", 0)
    monkeypatch.setattr(Raising, "error", OutputError("run: no space left"))
    assert spun(monkeypatch) == 1
    assert capsys.readouterr().err.endswith("error: run: no space left\n")
    assert Raising.spins == 1


def spun(monkeypatch: pytest.MonkeyPatch) -> int:
    """Run a node in this process, which goes on to be told of signals."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(gc, "freeze", lambda: None)
    try:
        return spin.run(lambda: Node("spun"), ["spun"])
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@each_executor
def test_what_comes_for_a_subscription_that_is_gone_by_then_ends_nothing(context: Context) -> None:
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
            wait_until(subscription.get_publisher_count, "the match")
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


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_is_about_to_wait_when_it_is_to_end_ends(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spin, "EventsExecutor", SingleThreadedExecutor)
    node = Node("spun", context=context)
    node.create_subscription(Empty, "never_said", lambda _: None, 1)
    about_to_wait, is_told = threading.Event(), threading.Event()
    can_execute, join = SingleThreadedExecutor.can_execute, threading.Thread.join

    def slow_can_execute(executor: SingleThreadedExecutor, entity: Any) -> bool:
        """Be in the middle of gathering what is to be waited for."""
        about_to_wait.set()
        assert is_told.wait(WAIT)
        return bool(can_execute(executor, entity))

    def telling(tell: Callable[..., Any]) -> Callable[..., Any]:
        def told(*arguments: Any) -> Any:
            done = tell(*arguments)
            is_told.set()
            return done

        return told

    def joined(thread: threading.Thread, *arguments: Any) -> None:
        if thread.name == "executor":
            is_told.set()
        join(thread, *arguments)

    monkeypatch.setattr(SingleThreadedExecutor, "can_execute", slow_can_execute)

    def spin_shortly() -> None:
        with spinning(node):
            assert about_to_wait.wait(WAIT)
            for name in ("wake", "shutdown"):
                told = telling(getattr(SingleThreadedExecutor, name))
                monkeypatch.setattr(SingleThreadedExecutor, name, told)
            monkeypatch.setattr(threading.Thread, "join", joined)

    spun = threading.Thread(target=spin_shortly, daemon=True)
    spun.start()
    spun.join(WAIT)
    assert not spun.is_alive()
    node.destroy_node()
