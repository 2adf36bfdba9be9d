# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The player: publishes a bag's messages, byte for byte, at their own pace or at the graph's.

Nothing is lost on the way: every publisher keeps all until its subscribers acknowledge, at full
speed only a window of feature frames runs ahead of ``slam/odometry``, and the player ends when
all that it sent has arrived.
"""

import struct
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from vislam_ros.core.settings import MotionSettings
from vislam_ros.data.bags import layout
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import FEATURES, IMAGES, IMU, ODOMETRY, TWIST, Topic
from vislam_ros.data.bags.naming import namespace_of
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.errors import VislamError
from vislam_ros.nodes.conversions import stamp_to_message, status, status_array
from vislam_ros.nodes.parameters import warn_of_undeclared_overrides
from vislam_ros.nodes.player.clock import PlaybackClock
from vislam_ros.nodes.player.graph import GraphWatch
from vislam_ros.nodes.player.options import PlayOptions, PlayReport
from vislam_ros.nodes.player.outlets import Outlet, make_outlets, sought_by, split_rules
from vislam_ros.nodes.player.read_ahead import read_ahead
from vislam_ros.nodes.player.window import FeatureWindow
from vislam_ros.nodes.spin import spinning
from vislam_ros.nodes.steady import steady_timer
from vislam_ros.nodes.topics import LATCHED, STREAM

Progress = Callable[[float], None]
"""Called with the seconds of the bag that were played in this pass."""

STALL_SECONDS = 5.0
DELIVERY_SECONDS = 60.0
PARTING_SECONDS = 0.5

_STATUS_PERIOD = 1.0
_COUNTED = (IMU, TWIST, FEATURES, *IMAGES)
_TIME_JUMP = round(MotionSettings.time_jump * NANOSECONDS)  # as the nodes have it by default
_HEADER_BYTES = 12  # what CDR itself begins with, and the stamp


class Player(Node):
    """Node ``player``, good for one :meth:`play`.

    Parameters
    ----------
    bag : BagMessages
        Open.
    options : PlayOptions
    context : rclpy.context.Context, optional

    Raises
    ------
    VislamError
        Where the bag has none of the topics to play, or not the part of it.
    """

    def __init__(self, bag: BagMessages, options: PlayOptions, context: Context | None = None):
        options.require_part(bag.path, bag.duration / NANOSECONDS)
        renamed, rules = split_rules(options.remap, bag.connections)
        super().__init__(
            "player",
            context=context,
            cli_args=["--ros-args", *rules] if rules else None,
            namespace=namespace_of(options.namespace) or None,
        )
        self.options = options
        self.clock = PlaybackClock(options.rate, paused=options.start_paused)
        self._bag = bag
        self._window = FeatureWindow(self.clock.condition)
        self._latest: dict[Topic, int] = {}  # stamp by role
        self._outlets = self._create_outlets(renamed)
        self._by_role = {outlet.role: outlet for outlet in self._outlets.values()}
        # Where there are no features, they are made of images, and a left one is a frame.
        images = () if FEATURES in self._by_role else IMAGES
        self._frame = next((t for t in (FEATURES, *images) if t in self._by_role), None)
        played = (IMU, *images) if images and self._frame else ()
        self._for_tracker = [self._by_role[topic] for topic in played if topic in self._by_role]
        self._graph = GraphWatch(self, self._window)
        self.report = PlayReport()
        self._began = 0.0
        self._status = self.create_publisher(DiagnosticArray, layout.PLAYER.name, LATCHED)
        steady_timer(self, _STATUS_PERIOD, self.publish_status)
        if options.clock_rate > 0.0:
            self._ros_clock = self.create_publisher(Clock, layout.CLOCK.name, STREAM)
            steady_timer(self, 1.0 / options.clock_rate, self._publish_clock)
        self._odometry = self.create_subscription(
            Odometry, ODOMETRY.name, self._on_odometry, STREAM, raw=True
        )
        for command in (self.pause, self.resume, self.step):
            self.create_service(Trigger, f"~/{command.__name__}", _answer(command))
        warn_of_undeclared_overrides(self)
        self.publish_status()

    def pause(self) -> None:
        """Hold the messages."""
        self.clock.pause()
        self.publish_status()

    def resume(self) -> None:
        """Go on."""
        self.clock.resume()
        self.publish_status()

    def toggle(self) -> None:
        """Pause or resume."""
        self.clock.toggle()
        self.publish_status()

    def step(self) -> None:
        """Pause, and play up to the next feature frame."""
        self.clock.step()
        self.publish_status()

    @property
    def state(self) -> str:
        """One of playing, paused, finished and interrupted."""
        if self.report.state:
            return self.report.state
        return "paused" if self.clock.paused else "playing"

    def play(self, progress: Progress | None = None) -> PlayReport:
        """Play the bag as the options say; the calling thread publishes.

        Returns when all is delivered, or soon after ``clock.interrupt()``.
        """
        report = self.report
        with spinning(self):
            self._wait_for_subscribers()
            self.clock.wait_for(lambda: False, self.options.delay)
            self._graph.begin()
            self._began = time.monotonic() - self.clock.seconds_paused()
            while self._play_once(progress) and self._drain():
                report.passes += 1
                if report.passes == self.options.passes:
                    break
            report.delivered = self._deliver()
            outlets = self._outlets.values()
            report.untaken = {outlet.name: outlet.untaken for outlet in outlets if outlet.untaken}
            report.state = "interrupted" if self.clock.interrupted else "finished"
            self.publish_status()
            self._part()
        return report

    def publish_status(self) -> None:
        """Say on ``player/status`` what is going on."""
        values = {
            "state": self.state,
            **{f"sent {topic.name}": self._sent(topic) for topic in _COUNTED},
            "features_acknowledged": self._window.acknowledged,
            "messages_sent": self.report.messages,
            "passes": self.report.passes,
            "rate": self.options.rate,
        }
        stamp = stamp_to_message(self.clock.position())
        self._status.publish(status_array(stamp, [status("player", values)]))

    def _create_outlets(self, renamed: Mapping[str, str]) -> dict[str, Outlet]:
        """Outlet of each topic that is to be played, by the name that the bag has for it."""
        connections = self._bag.connections
        recorded = {connection.topic for connection in connections}
        chosen = {f"/{topic.lstrip('/')}" for topic in self.options.topics} or recorded
        if unknown := chosen - recorded:
            raise VislamError(
                f"{self._bag.path}: has no topic {', '.join(sorted(unknown))}: choose from "
                f"{', '.join(sorted(recorded)) or 'none'}"
            )
        return make_outlets(self, connections, chosen, renamed)

    def _wait_for_subscribers(self) -> None:
        motion = TWIST if TWIST in self._by_role else IMU
        roles = (motion, FEATURES, *(o.role for o in self._for_tracker if o.role in IMAGES))
        needed = {role: self.options.subscribers for role in roles if role is not None}
        # What is kept for those who come later need not wait for them.
        needed.update(dict.fromkeys(CALIBRATION_TOPICS, 1))
        waiting = [
            (topic, self._by_role[topic], count)
            for topic, count in needed.items()
            if topic in self._by_role and not self._by_role[topic].latched
        ]

        def missing() -> list[str]:
            links = [
                f"{count} subscriber(s) of {topic.name}"
                for topic, outlet, count in waiting
                if outlet.subscribers < count and not self._is_replaced(topic, count)
            ]
            links += sought_by(self, (self._by_role.get(topic) for topic in (TWIST, IMU)))
            whole = self.options.whole_graph
            if self.options.rate == 0.0:
                links += [f"a report of {name}" for name in self._graph.silent()]
            if whole or self.options.rate == 0.0:
                links += self._graph.missing(self._for_tracker, whole=whole)
            return links

        if self.options.wait > 0.0 and (links := missing()):
            self.get_logger().info(f"waiting up to {self.options.wait:g} s for {', '.join(links)}")
        if not self.clock.wait_for(lambda: not missing(), self.options.wait):
            links = missing()
            if links and self.options.wait > 0.0 and not self.clock.interrupted:
                self.get_logger().warning(
                    f"playing after {self.options.wait:g} s without {', '.join(links)}: start "
                    "the nodes first, or wait longer"
                )

    def _is_replaced(self, topic: Topic, count: int) -> bool:
        """Whether the nodes take the gyroscope's messages, and nobody those of this topic."""
        twist, imu = self._by_role.get(TWIST), self._by_role.get(IMU)
        if topic is not TWIST or twist is None or imu is None:
            return False
        return imu.subscribers >= count and not self.count_subscribers(twist.name)

    def _play_once(self, progress: Progress | None) -> bool:
        """Publish the chosen part of the bag; whether it came to its end."""
        begin = round(self.options.start_offset * NANOSECONDS)
        end = begin + self.options.duration * NANOSECONDS
        stop = None if end > self._bag.duration else round(end)
        messages = self._bag.messages(self._outlets.keys(), start_offset=begin, stop_offset=stop)
        begin += self._bag.start
        before = self.report.bag_seconds
        self._window.expect()
        self._latest.clear()
        self.clock.start(begin)
        with closing(read_ahead(messages)) as ahead:
            for connection, stamp, data in ahead:
                if not self._play_message(self._outlets[connection.topic], stamp, data):
                    return False
                played = max(0.0, (stamp - begin) / NANOSECONDS)
                self._count(before + played)
                if progress:
                    progress(played)
        return True

    def _play_message(self, outlet: Outlet, stamp: int, data: bytes) -> bool:
        """Publish a message when it is due; False if interrupted."""
        is_frame = outlet.role is not None and outlet.role is self._frame
        if not self.clock.wait(stamp):
            return False
        if self.options.rate == 0.0 and self._begins_anew(outlet.role, data):
            self._wait_for_answers(0)
        if is_frame:
            if self.options.rate == 0.0 and self._window.waiting >= self.options.window:
                self._wait_for_answers(self.options.window // 2)
            self._window.add(_header_stamp(data))
        if not self._send(outlet, data):
            return False
        self.clock.sent(stamp, ends_step=is_frame or not self._frame)
        return True

    def _begins_anew(self, role: Topic | None, data: bytes) -> bool:
        """Whether time begins anew with a message: no stream is to be a pass ahead of another."""
        stamp = _header_stamp(data) if role in _COUNTED else None
        if role is None or stamp is None:
            return False
        before = self._latest.get(role, stamp)
        self._latest[role] = stamp
        return stamp < before - _TIME_JUMP

    def _count(self, bag_seconds: float) -> None:
        self.report.messages += 1
        self.report.bag_seconds = bag_seconds
        running = time.monotonic() - self._began - self.clock.seconds_paused()
        self.report.wall_seconds = max(running, 1e-9)

    def _sent(self, topic: Topic) -> int:
        """How many messages were sent on a topic of a drive."""
        return self._by_role[topic].sent if topic in self._by_role else 0

    def _send(self, outlet: Outlet, data: bytes) -> bool:
        """Publish however long it takes the subscribers to make room; False if interrupted."""
        while not outlet.send(data):
            if self.clock.interrupted or not self.context.ok():
                return False
        return True

    def _wait_for_answers(self, most_waiting: int) -> None:
        """Wait until at most so many frames are unanswered, if anybody answers at all.

        What waits in a graph that has taken all else waits for motion that the bag holds later,
        or not at all. A node that is busy, as with the exact map of the last pass, is waited for
        as long as it is there.
        """
        window = self._window
        window.enough = most_waiting
        while window.waiting > most_waiting and window.answered:
            if self._is_at_rest():
                window.forget()
                return
            if self.clock.interrupted or not self.count_publishers(self._odometry.topic_name):
                return
            before = window.progress
            has_answers = self.clock.wait_for(self._has_answers, STALL_SECONDS)
            moved_on = has_answers or window.progress != before
            if not (moved_on or self.clock.interrupted or self._graph.is_busy()):
                self.get_logger().warning(
                    f"{self._odometry.topic_name} has not answered {window.waiting} feature "
                    f"frame(s) for {STALL_SECONDS:g} s: going on without"
                )
                window.expect_none()

    def _has_answers(self) -> bool:
        """Whether the graph has answered enough frames, or has done all."""
        return self._window.waiting <= self._window.enough or self._is_at_rest()

    def _is_at_rest(self) -> bool:
        sent = {topic.name: self._sent(topic) for topic in _COUNTED}
        return self._graph.is_at_rest(sent)

    def _drain(self) -> bool:
        """Wait until the graph has answered all frames; False if interrupted."""
        self._wait_for_answers(0)
        return not self.clock.interrupted

    def _deliver(self) -> bool:
        """Wait until all messages are acknowledged; whether they are."""
        return self._are_taken([outlet.publisher for outlet in self._outlets.values()])

    def _part(self) -> None:
        """Wait until the last word is taken: a recorder that misses it waits for ever.

        The network between the two may be down just now.
        """
        self._are_taken([self._status])

    def _are_taken(self, publishers: Iterable[Publisher]) -> bool:
        began = time.monotonic()
        for publisher in publishers:
            while not publisher.wait_for_all_acked(Duration(seconds=0.1)):
                patience = PARTING_SECONDS if self.clock.interrupted else DELIVERY_SECONDS
                if time.monotonic() > began + patience:
                    self.get_logger().warning(
                        f"{publisher.topic_name}: a subscriber has not taken all messages in "
                        f"{patience:g} s"
                    )
                    return False
        return True

    def _publish_clock(self) -> None:
        self._ros_clock.publish(Clock(clock=stamp_to_message(self.clock.position())))

    def _on_odometry(self, data: bytes) -> None:
        stamp = _header_stamp(data)
        if stamp is not None:
            self._window.acknowledge(stamp)


def _header_stamp(data: bytes) -> int | None:
    """Stamp (ns) of the header that begins a message, None where its CDR bytes are too few."""
    if len(data) < _HEADER_BYTES:
        return None
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", data, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _answer(
    command: Callable[[], None],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    """Service callback that obeys and agrees."""

    def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        command()
        response.success = True
        return response

    return callback
