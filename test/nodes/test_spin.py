# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import threading
from collections.abc import Callable
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Empty

from vislam_ros.nodes.spin import spinning

WAIT = 10.0


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


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_is_about_to_wait_when_it_is_to_end_ends(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = Node("spun", context=context)
    node.create_subscription(Empty, "never_said", lambda _: None, 1)
    about_to_wait, is_told = threading.Event(), threading.Event()
    can_execute = SingleThreadedExecutor.can_execute

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

    monkeypatch.setattr(SingleThreadedExecutor, "can_execute", slow_can_execute)

    def spin_shortly() -> None:
        with spinning(node):
            assert about_to_wait.wait(WAIT)
            for name in ("wake", "shutdown"):
                told = telling(getattr(SingleThreadedExecutor, name))
                monkeypatch.setattr(SingleThreadedExecutor, name, told)

    spun = threading.Thread(target=spin_shortly, daemon=True)
    spun.start()
    spun.join(WAIT)
    assert not spun.is_alive()
    node.destroy_node()
