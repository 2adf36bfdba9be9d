# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process: one line where it cannot start, exit 0 where a signal ends it.

Nodes are spun by the executor of rclpy that is told what comes, where there is one. The other
gathers all that may come before each callback, in Python: a sixth of the way from features to
odometry.
"""

import atexit
import gc
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Protocol, runtime_checkable

import rclpy
import rclpy.logging
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args, try_shutdown

from vislam_ros.errors import OutputError, VislamError, one_line
from vislam_ros.nodes.diagnostics import Monitor, is_told

try:
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # before 7.1.4
    EventsExecutor = SingleThreadedExecutor

LAST = signal.SIGUSR1
"""Tells a node to end, and that nobody is left of its graph who could answer it."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM, LAST)
# How soon a signal, or the end, is noticed where nothing else happens. rclpy's executor must not
# be let wait without an end: it would do so in a busy loop.
_POLL_SECONDS = 0.05
_ARRIVAL_SECONDS = 0.3
_LONGEST_SECONDS = 5.0
# A signal that comes so soon after the first is the same wish.
_AT_ONCE_SECONDS = 1.0


@runtime_checkable
class WindsUp(Protocol):
    """A node that has something to do when it is told to end."""

    def wind_up(self, *, hurried: bool) -> bool:
        """Tell whether the node may end; it is spun, and asked again, until it may.

        But for the first time it is asked when nothing waits to be taken. It is hurried where it
        was told again, or is the last one.
        """


@runtime_checkable
class Monitored(Protocol):
    """A node whose monitor keeps what it cannot go on after."""

    @property
    def monitor(self) -> Monitor:
        """The monitor; raised from a callback, a failure would be logged with a traceback."""


@runtime_checkable
class EndsItself(Protocol):
    """A node that may be told to end by other ways than a signal."""

    @property
    def is_told_to_end(self) -> bool:
        """Whether it was."""


def run(make_node: Callable[[], Node], args: list[str] | None = None) -> int:
    """Make a node and spin it until SIGINT or SIGTERM.

    The first signal lets the callback at work finish. Then a node that :class:`WindsUp` does so,
    and hurries if another signal comes, but for one that comes at once: a terminal and a launcher
    may both send the first. :data:`LAST` hurries it from the start. What any node has published
    gets a moment to arrive. A node that has files or threads to finish does so in
    ``destroy_node``.

    Parameters
    ----------
    make_node : callable
    args : list of str, optional
        Command line with the program's name, :data:`sys.argv` by default.

    Returns
    -------
    int
        0 after a signal or ``--help``, 1 where the node could not start or could not go on.
    """
    told = _Told()

    def on_signal(number: int, _frame: FrameType | None) -> None:
        # rclpy's own handler would shut the context down with all that still waits in it.
        told.take(number, time.monotonic())

    atexit.register(gc.freeze)  # a collection before the end frees nothing and takes long
    for number in _SIGNALS:
        signal.signal(number, on_signal)
    try:
        init_ros(args)
        if _wants_help(args):
            print(_usage(args))
            return 0
        node = make_node()
        # What is there by now stays. A collection that looked at it would take longer than steps.
        gc.freeze()
        _spin(node, told)
    except (VislamError, RuntimeError, ParameterException) as error:
        with suppress(OSError):  # nobody may be left to hear it
            print(f"error: {one_line(ros_reason(error))}", file=sys.stderr)
        return 1
    finally:
        try_shutdown()
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
    return 0


class _Told:
    """What the signals say that came so far."""

    def __init__(self) -> None:
        self.to_end = self.to_hurry = False
        self._first = 0.0

    def take(self, number: int, now: float) -> None:
        """Take a signal at a time (s, monotonic)."""
        if not self.to_end:
            self.to_end, self._first = True, now
        self.to_hurry |= number == LAST or now - self._first > _AT_ONCE_SECONDS


@contextmanager
def spinning(node: Node) -> Iterator[None]:
    """Let a thread spin a node while the block runs; it goes on after what a callback raises."""
    executor = executor_of(node.context)
    caller = _Caller(executor, node)
    executor.add_node(node)
    is_over = threading.Event()

    def spin() -> None:
        try:
            while not is_over.is_set():
                caller.call_back(_POLL_SECONDS)
        except Exception as error:
            if node.context.ok():
                node.get_logger().error(one_line(ros_reason(error)))

    thread = threading.Thread(target=spin, name="executor")
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
        executor.shutdown()


def init_ros(args: list[str] | None = None) -> None:
    """Initialise ROS without its signal handlers, which would shut it down at once.

    Parameters
    ----------
    args : list of str, optional
        Command line with the program's name, :data:`sys.argv` by default.

    Raises
    ------
    VislamError
        Where an argument will not do; ROS's own lines about it would stand beside ours.
    """
    with _silent_rcl():
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise VislamError(ros_reason(error)) from error


@contextmanager
def _silent_rcl() -> Iterator[None]:
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.FATAL)
    try:
        yield
    finally:
        rclpy.logging.set_logger_level("rcl", LoggingSeverity.UNSET)


def _wants_help(args: Sequence[str] | None) -> bool:
    """Tell whether a command line asks for help; refuse what stands outside ROS's arguments.

    rclpy would pass over it in silence, so ``-p`` without ``--ros-args`` would change nothing.
    """
    with _silent_rcl():
        others = remove_ros_args(args)[1:]
    if {"-h", "--help"} & set(others):
        return True
    if others:
        raise VislamError(f"arguments outside --ros-args: {' '.join(others)}; see --help")
    return False


def _usage(args: Sequence[str] | None) -> str:
    program = Path((sys.argv if args is None else args)[0]).stem
    return f"""\
usage: {program} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...]

Runs until Ctrl-C. config/ekf.yaml explains the parameters, docs/topics.md the topics.

examples:
  {program} --ros-args --params-file config/ekf.yaml
  {program} --ros-args -r __ns:=/robot1 --log-level warn"""


def executor_of(context: Context) -> Executor:
    """Make what calls back the nodes of a context as soon as something comes for them."""
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    executor = EventsExecutor(context=context)
    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():  # some releases of rclpy put theirs there
            signal.signal(number, handler)
    return executor


def _spin(node: Node, told: _Told) -> None:
    executor = executor_of(node.context)
    caller = _Caller(executor, node)
    monitor = node.monitor if isinstance(node, Monitored) else None

    def spin_once(timeout: float = _POLL_SECONDS) -> None:
        caller.call_back(timeout)
        if monitor is not None and monitor.failure is not None:
            raise monitor.failure

    try:
        executor.add_node(node)
        ends_itself = node if isinstance(node, EndsItself) else None
        while not (told.to_end or (ends_itself is not None and ends_itself.is_told_to_end)):
            spin_once()
        while isinstance(node, WindsUp) and not node.wind_up(hurried=told.to_hurry):
            spin_once()
            _work_off(executor, spin_once)
        _let_arrive(node)
    except BaseException:
        executor.shutdown()
        with suppress(VislamError):  # the error at hand came first
            node.destroy_node()
        raise
    executor.shutdown()
    node.destroy_node()


class _Caller:
    """Calls back for what comes to a node, and goes on after what a callback raises.

    rclpy's own services raise for requests that they do not understand. They are answered before
    that reaches the executor, which would forget whatever else waits for the same service.
    """

    def __init__(self, executor: Executor, node: Node):
        self._executor = executor
        self._node = node
        self._passed_over: Counter[str] = Counter()
        self._failing_since: float | None = None
        for service in node.services:
            service.callback = self._guarded(service.callback)

    def _guarded(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Answer requests; an answer that fails is as empty as it was at first."""

        def guarded(request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except OutputError:
                raise
            except Exception as error:
                self._pass_over(error)
                return response

        return guarded

    def call_back(self, timeout: float) -> None:
        """Call back for one thing that came, or comes within so many seconds.

        Raises
        ------
        OutputError
            As a callback raised it.
        VislamError
            Where nothing goes well any more: no message is the cause of that.
        Exception
            Where the context is shut down.
        """
        try:
            self._executor.spin_once(timeout_sec=timeout)
        except InvalidHandle:  # what it came for was destroyed meanwhile
            pass
        except Exception as error:  # also of a message that cannot be decoded
            if isinstance(error, OutputError) or not self._node.context.ok():
                raise
            self._failing_since = self._failing_since or time.monotonic()
            if time.monotonic() - self._failing_since > _LONGEST_SECONDS:
                raise VislamError(f"cannot go on: {ros_reason(error)}") from error
            self._pass_over(error)
        else:
            self._failing_since = None

    def _pass_over(self, error: Exception) -> None:
        """Log the first of a kind, then the 10th, the 100th, ..."""
        kind = type(error).__name__
        before = self._passed_over[kind]
        self._passed_over[kind] = count = before + 1
        if is_told(before, count):
            reason = one_line(ros_reason(error))
            self._node.get_logger().error(f"passed over, {count} so far: {kind}: {reason}")


def _work_off(executor: Executor, spin_once: Callable[[float], None]) -> None:
    """Take what waits until nothing does, but not for ever: more may come all the time."""
    end = time.monotonic() + _LONGEST_SECONDS
    callbacks = 2
    while callbacks > 1:  # more than the last
        last = executor.create_task(lambda: None)  # behind all that waits
        callbacks = 0
        while not last.done() and time.monotonic() < end:
            spin_once(0.0)
            callbacks += 1


def _let_arrive(node: Node) -> None:
    """Wait until the subscribers have what was published, but not long: one may be dead."""
    end = time.monotonic() + _ARRIVAL_SECONDS
    for publisher in node.publishers:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))


def ros_reason(error: Exception) -> str:
    """One line of an error, without the places in rcl's sources that passed it on."""
    lines = str(error).splitlines() or [type(error).__name__]
    text = lines[0].split(", at /")[0].removeprefix("failed to initialize rcl: ")
    if text.startswith("["):  # all that rclpy says of arguments that it does not know
        return f"no such ROS arguments: {text}"
    if "logging directory" in text:
        return "no folder for log files: set HOME or ROS_LOG_DIR"
    return text
