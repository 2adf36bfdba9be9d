# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process: one line where it cannot start, exit 0 where a signal ends it."""

import signal
import sys
from collections.abc import Callable
from types import FrameType

import rclpy
import rclpy.logging
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.node import Node
from rclpy.utilities import ok, try_shutdown

from vislam_ros.errors import VislamError, one_line


def run(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Make a node and spin it until SIGINT or SIGTERM.

    The first SIGINT lets the callback at work finish; further ones do nothing. A node that has
    files or threads to finish does so in ``destroy_node``.

    Parameters
    ----------
    make_node : callable
    args : list of str, optional
        Command line with the program's name, :data:`sys.argv` by default.

    Returns
    -------
    int
        0 after a signal, 1 where the node could not start or not finish its files.
    """
    interrupted = initialized = False

    def on_interrupt(_signal: int, _frame: FrameType | None) -> None:
        # rclpy's handler runs first and shuts the context down, which ends the spinning.
        nonlocal interrupted
        interrupted = True

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        try:
            _init(args)
            initialized = True
            node = make_node()
        except Exception:
            if interrupted or (initialized and not ok()):
                return 0  # the context went away while the node was being made
            raise
        _spin(node)
    except (VislamError, RuntimeError) as error:
        print(f"error: {one_line(_reason(error))}", file=sys.stderr)
        return 1
    finally:
        try_shutdown()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return 0


def _init(args: list[str] | None) -> None:
    """Initialise ROS, whose own lines about bad arguments would stand beside ours."""
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.FATAL)
    rclpy.init(args=args)
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.UNSET)


def _spin(node: Node) -> None:
    executor = SingleThreadedExecutor()
    try:
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # A signal may shut the context down between any two calls of the executor.
        if ok():
            raise
    finally:
        executor.shutdown()
        node.destroy_node()


def _reason(error: Exception) -> str:
    """One line of an error, without the places in rcl's sources that passed it on."""
    lines = str(error).splitlines() or [type(error).__name__]
    text = lines[0].split(", at /")[0].removeprefix("failed to initialize rcl: ")
    if "logging directory" in text:
        return "no folder for log files: set HOME or ROS_LOG_DIR"
    return text
