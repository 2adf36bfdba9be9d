# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Timers that go on where simulated time stands still, as it does before /clock and after it."""

from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call back every so many seconds of real time."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
