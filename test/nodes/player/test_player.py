# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The player in a graph of its own: what it sends arrives, all of it, when it should."""

import dataclasses
import os
import subprocess
import sys
import threading
import time
from collections import Counter, defaultdict

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from places import REPOSITORY
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Imu, PointCloud2
from std_srvs.srv import Trigger

from vislam_ros.data.bags.reader import BagMessages
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.player import player
from vislam_ros.nodes.player.options import PlayOptions
from vislam_ros.nodes.player.player import Player
from vislam_ros.nodes.qos import LATCHED, STREAM

WAIT = 30.0
STEPS = 40
FULL_SPEED = PlayOptions(rate=0.0, wait=WAIT)

STREAMS = {
    "/imu/data": Imu,
    "/imu/twist": TwistWithCovarianceStamped,
    "/stereo/features": PointCloud2,
}
LATCHES = {
    "/stereo/left/camera_info": CameraInfo,
    "/stereo/right/camera_info": CameraInfo,
    "/stereo/extrinsics": TransformStamped,
}


@pytest.fixture(scope="module")
def drive():
    return simulate(SimulationSettings(steps=STEPS, landmarks=150)).drive


@pytest.fixture(scope="module")
def bag_path(tmp_path_factory, drive):
    path = tmp_path_factory.mktemp("player") / "bag"
    write_bag(drive, path)
    return path


@pytest.fixture
def bag(bag_path):
    with BagMessages(bag_path) as bag:
        yield bag


class Listener(Node):
    """Keeps the raw messages of topics, and answers features if it is told to."""

    def __init__(self, context, *, topics=None, delay=0.0):
        super().__init__("listener", context=context)
        self.heard = defaultdict(list)
        self.delay = delay
        self.ahead = []
        for topic, message_type in (topics or {**STREAMS, **LATCHES}).items():
            self.listen(topic, message_type)
        self.states = []
        self.create_subscription(DiagnosticArray, "player/status", self._on_status, LATCHED)

    def listen(self, topic, message_type):
        def keep(data):
            if self.delay:
                time.sleep(self.delay)
            self.heard[topic].append(data)

        qos = LATCHED if topic in LATCHES else STREAM
        self.create_subscription(message_type, topic, keep, qos, raw=True)

    def answer_features(self, every):
        """Answer every so many feature frames, and note how many were unanswered."""
        odometry = self.create_publisher(Odometry, "slam/odometry", STREAM)
        waiting = []

        def answer(message):
            waiting.append(message.header)
            self.ahead.append(len(waiting))
            if len(waiting) == every:
                odometry.publish(Odometry(header=waiting[-1]))
                waiting.clear()

        self.create_subscription(PointCloud2, "/stereo/features", answer, STREAM)

    def _on_status(self, message):
        self.states.append(conversions.status_values(message, "player"))


@pytest.fixture
def listen(context):
    """Make a listener that a thread spins."""
    executor = SingleThreadedExecutor(context=context)
    thread = threading.Thread(target=executor.spin)
    nodes = []

    def start(**options):
        node = Listener(context, **options)
        nodes.append(node)
        executor.add_node(node)
        if not thread.is_alive():
            thread.start()
        return node

    yield start
    executor.shutdown()
    if thread.is_alive():
        thread.join(WAIT)
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def make_player(context, bag):
    players = []

    def make(options, source=bag):
        node = Player(source, options, context)
        players.append(node)
        return node

    yield make
    for node in players:
        node.destroy_node()


@pytest.fixture
def play_in_thread():
    """Start a player; the test interrupts it or waits for its report."""
    started = []

    def start(node):
        reports = []
        thread = threading.Thread(target=lambda: reports.append(node.play()))
        thread.start()
        started.append((node, thread))

        def report():
            thread.join(WAIT)
            assert not thread.is_alive(), "the player did not end"
            return reports[0]

        return report

    yield start
    for node, thread in started:
        node.clock.interrupt()
        thread.join(WAIT)


def wait_until(condition, what):
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen"
        time.sleep(0.01)


def recorded(bag, topic, **part):
    return [data for _, _, data in bag.messages([topic], **part)]


@pytest.mark.parametrize("rate", [0.0, 20.0])
def test_every_message_arrives_byte_for_byte_and_in_order(listen, make_player, bag, rate):
    listener = listen()
    report = make_player(dataclasses.replace(FULL_SPEED, rate=rate)).play()
    assert (report.state, report.delivered, report.passes) == ("finished", True, 1)
    for topic in (*STREAMS, *LATCHES):
        sent = recorded(bag, topic)
        wait_until(lambda t=topic, s=sent: len(listener.heard[t]) >= len(s), f"all of {topic}")
        assert listener.heard[topic] == sent
    if rate:
        assert report.rate == pytest.approx(rate, rel=0.5)


SLOW_SUBSCRIBER = """\
import sys, time
import rclpy
from geometry_msgs.msg import TwistWithCovarianceStamped
from vislam_ros.nodes.qos import STREAM

heard = []
def hear(data):
    time.sleep(1e-4)
    heard.append(data)

rclpy.init()
node = rclpy.create_node("dawdler")
node.create_subscription(TwistWithCovarianceStamped, "/imu/twist", hear, STREAM, raw=True)
deadline = time.monotonic() + 60.0
while len(heard) < int(sys.argv[1]) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.5)
sys.stdout.buffer.write(b"".join(heard))
rclpy.shutdown()
"""


def test_a_slow_subscriber_loses_nothing_at_full_speed(make_player, drive, tmp_path, domain_id):
    """More messages than writer and reader can hold together, to a reader that dawdles."""
    count = 12_000
    stamps = drive.twist_stamps[0] + np.arange(count) * 1_000_000
    twists = np.zeros((count, 6))
    twists[:, 0] = np.arange(count)
    path = tmp_path / "long_bag"
    write_bag(
        dataclasses.replace(drive, twist_stamps=stamps, twists=twists, ground_truth=None), path
    )
    # In this process the blocked publisher would keep the interpreter from the subscriber.
    subscriber = subprocess.Popen(
        [sys.executable, "-c", SLOW_SUBSCRIBER, str(count)],
        cwd=REPOSITORY,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain_id)},
        stdout=subprocess.PIPE,
    )
    try:
        with BagMessages(path) as long_bag:
            options = dataclasses.replace(FULL_SPEED, topics=("imu/twist",))
            report = make_player(options, long_bag).play()
            heard, _ = subscriber.communicate(timeout=60.0)
            assert (report.messages, report.delivered) == (count, True)
            assert heard == b"".join(recorded(long_bag, "/imu/twist"))
    finally:
        subscriber.kill()
        subscriber.wait()


@pytest.mark.parametrize("window", [4, 20])
def test_at_full_speed_only_a_window_is_ahead_of_the_answers(listen, make_player, window):
    listener = listen(topics={"/imu/twist": TwistWithCovarianceStamped})
    listener.answer_features(every=window)
    options = dataclasses.replace(FULL_SPEED, window=window)
    node = make_player(options)
    report = node.play()
    assert report.state == "finished"
    assert len(listener.ahead) == STEPS
    # The listener waits for a full window, which the player cannot pass.
    assert max(listener.ahead) == window
    wait_until(lambda: listener.states[-1]["state"] == "finished", "the last status")
    assert listener.states[-1]["features_sent"] == str(STEPS)
    assert listener.states[-1]["features_acknowledged"] == str(STEPS)


@pytest.mark.parametrize("stalled_at", ["the window", "the end"])
def test_a_graph_that_does_not_answer_does_not_hold_the_player_up(
    listen, make_player, monkeypatch, stalled_at
):
    monkeypatch.setattr(player, "STALL_SECONDS", 0.2)
    listener = listen()
    listener.answer_features(every=10**6)
    window = 4 if stalled_at == "the window" else 1000
    report = make_player(dataclasses.replace(FULL_SPEED, window=window)).play()
    assert (report.state, report.delivered) == ("finished", True)
    wait_until(lambda: len(listener.heard["/stereo/features"]) == STEPS, "the features")


def test_a_part_of_the_bag_comes_with_the_latched_messages_from_before(listen, make_player, bag):
    listener = listen()
    part = dataclasses.replace(FULL_SPEED, start_offset=2.0, duration=1.0)
    make_player(part).play()
    for topic in LATCHES:
        wait_until(lambda t=topic: listener.heard[t], topic)
        assert listener.heard[topic] == recorded(bag, topic)
    expected = recorded(
        bag, "/stereo/features", start_offset=2_000_000_000, stop_offset=3_000_000_000
    )
    assert 9 <= len(expected) <= 11
    wait_until(lambda: len(listener.heard["/stereo/features"]) >= len(expected), "the features")
    assert listener.heard["/stereo/features"] == expected


def test_a_loop_sends_the_same_stamps_again(listen, make_player, bag):
    listener = listen()
    report = make_player(dataclasses.replace(FULL_SPEED, passes=2)).play()
    assert (report.passes, report.state) == (2, "finished")
    sent = recorded(bag, "/stereo/features")
    wait_until(lambda: len(listener.heard["/stereo/features"]) >= 2 * STEPS, "both passes")
    assert listener.heard["/stereo/features"] == sent + sent


def call(node, name):
    client = node.create_client(Trigger, f"player/{name}")
    assert client.wait_for_service(WAIT)
    future = client.call_async(Trigger.Request())
    wait_until(future.done, f"the answer of player/{name}")
    assert future.result().success


def test_services_pause_step_and_resume(listen, make_player, play_in_thread):
    listener = listen()
    features = listener.heard["/stereo/features"]
    report = play_in_thread(make_player(dataclasses.replace(FULL_SPEED, start_paused=True)))
    wait_until(lambda: listener.states and listener.states[-1]["state"] == "paused", "the pause")
    for count in (1, 2):
        call(listener, "step")
        wait_until(lambda n=count: len(features) == n, "a step")
        # The twist of the step came with it, and nothing from after it.
        wait_until(lambda n=count: len(listener.heard["/imu/twist"]) == n, "its twist")
    call(listener, "resume")
    assert report().state == "finished"
    wait_until(lambda: len(features) == STEPS, "the rest")
    call_states = [status["state"] for status in listener.states]
    wait_until(lambda: listener.states[-1]["state"] == "finished", "the last status")
    assert "paused" in call_states


def test_a_pause_in_the_middle_holds_the_messages(listen, make_player, play_in_thread):
    listener = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, rate=1.0))
    report = play_in_thread(node)
    wait_until(lambda: len(listener.heard["/stereo/features"]) > 2, "the first features")
    call(listener, "pause")
    position = node.clock.position()
    assert node.state == "paused"
    assert node.clock.position() == position
    node.clock.interrupt()
    assert report().state == "interrupted"


def test_an_interrupt_is_said_to_those_who_come_later(listen, make_player, play_in_thread):
    first = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, rate=0.1, passes=0))
    report = play_in_thread(node)
    wait_until(lambda: first.heard["/stereo/features"], "the first features")
    node.clock.interrupt()
    assert report().state == "interrupted"
    later = listen()
    wait_until(lambda: later.states, "the status")
    assert later.states[-1]["state"] == "interrupted"
    assert int(later.states[-1]["messages_sent"]) == report().messages


def test_an_interrupt_ends_the_wait_for_subscribers(make_player, play_in_thread):
    node = make_player(dataclasses.replace(FULL_SPEED, wait=1000.0))
    report = play_in_thread(node)
    node.clock.interrupt()
    assert (report().state, report().messages) == ("interrupted", 0)


def test_without_subscribers_it_plays_after_the_wait(make_player, bag):
    report = make_player(dataclasses.replace(FULL_SPEED, wait=0.1)).play()
    assert report.state == "finished"
    assert report.messages >= STEPS


def test_it_waits_until_the_whole_graph_is_there(listen, make_player, play_in_thread):
    listener = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, whole_graph=True))
    report = play_in_thread(node)
    wait_until(lambda: listener.states, "the first status")
    wait_until(lambda: node.count_subscribers("/stereo/features"), "the discovery")
    assert not listener.heard["/stereo/features"]
    node.clock.interrupt()
    assert report().messages == 0


def test_only_the_chosen_topics_are_played_and_under_their_new_names(listen, make_player, bag):
    listener = listen(topics={"/car/twist": TwistWithCovarianceStamped})
    options = dataclasses.replace(
        FULL_SPEED, topics=("imu/twist",), remap=("/imu/twist:=/car/twist",)
    )
    report = make_player(options).play()
    assert report.messages == STEPS
    wait_until(lambda: len(listener.heard["/car/twist"]) >= STEPS, "the twists")
    assert listener.heard["/car/twist"] == recorded(bag, "/imu/twist")


def test_a_topic_that_the_bag_does_not_have_is_an_error_with_a_choice(make_player):
    with pytest.raises(VislamError, match=r"no topic /imu/mag: choose from .*/imu/twist"):
        make_player(dataclasses.replace(FULL_SPEED, topics=("imu/mag",)))


def test_a_topic_whose_type_is_not_installed_is_left_out(make_player, bag, monkeypatch):
    def find(msgtype, find=player._message_class):
        return None if msgtype.startswith("sensor_msgs/msg/Imu") else find(msgtype)

    monkeypatch.setattr(player, "_message_class", find)
    counts = Counter({connection.topic: connection.count for connection in bag.connections})
    played = [*STREAMS, *LATCHES]
    played.remove("/imu/data")
    options = dataclasses.replace(FULL_SPEED, wait=0.0, topics=(*STREAMS, *LATCHES))
    assert make_player(options).play().messages == sum(counts[topic] for topic in played)


def test_the_ros_clock_is_the_bags_time(listen, make_player, bag):
    listener = listen(topics={"/imu/twist": TwistWithCovarianceStamped, "/clock": Clock})
    listener.listen("/stereo/features", PointCloud2)
    make_player(dataclasses.replace(FULL_SPEED, rate=10.0, clock_rate=50.0)).play()
    wait_until(lambda: len(listener.heard["/stereo/features"]) == STEPS, "the features")
    stamps = [
        conversions.stamp_from_message(deserialize_message(data, Clock).clock)
        for data in listener.heard["/clock"]
    ]
    inside = [stamp for stamp in stamps if bag.start <= stamp <= bag.end]
    assert len(inside) > 3
    assert inside == sorted(inside)
