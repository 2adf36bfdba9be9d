# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The player in a graph of its own: what it sends arrives, all of it, when it should."""

import dataclasses
import os
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from live.listening import FULL_SPEED, LATCHES, STEPS, STREAMS, recorded, wait_until
from places import REPOSITORY
from rclpy.serialization import deserialize_message
from rewriting import JUNK, changing, rewritten
from rosgraph_msgs.msg import Clock

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.layout import CLOCK, FEATURES, IMU, TWIST
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.errors import VislamError
from vislam_ros.nodes.player import outlets, player


@pytest.mark.parametrize("rate", [0.0, 20.0])
def test_every_message_arrives_byte_for_byte_and_in_order(listen, make_player, bag, rate):
    listener = listen()
    report = make_player(dataclasses.replace(FULL_SPEED, rate=rate)).play()
    assert (report.state, report.delivered, report.passes) == ("finished", True, 1)
    for topic in (*STREAMS, *LATCHES):
        sent, heard = recorded(bag, topic.recorded), listener.heard[topic.recorded]
        wait_until(lambda h=heard, s=sent: len(h) >= len(s), f"all of {topic.name}")
        assert heard == sent
    if rate:
        assert report.rate == pytest.approx(rate, rel=0.5)


SLOW_SUBSCRIBER = """\
import sys, time
import rclpy
from geometry_msgs.msg import TwistWithCovarianceStamped
from vislam_ros.data.bags.layout import TWIST
from vislam_ros.nodes.topics import STREAM

heard = []
def hear(data):
    time.sleep(1e-4)
    heard.append(data)

rclpy.init()
node = rclpy.create_node("dawdler")
node.create_subscription(TwistWithCovarianceStamped, TWIST.name, hear, STREAM, raw=True)
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
            options = dataclasses.replace(FULL_SPEED, topics=(TWIST.name,))
            report = make_player(options, long_bag).play()
            heard, _ = subscriber.communicate(timeout=60.0)
            assert (report.messages, report.delivered) == (count, True)
            assert heard == b"".join(recorded(long_bag, TWIST.recorded))
    finally:
        subscriber.kill()
        subscriber.wait()


@pytest.mark.parametrize("window", [4, 20])
def test_at_full_speed_only_a_window_is_ahead_of_the_answers(listen, make_player, window):
    listener = listen(topics=[TWIST])
    listener.answer_features(every=window)
    options = dataclasses.replace(FULL_SPEED, window=window)
    node = make_player(options)
    report = node.play()
    assert report.state == "finished"
    assert len(listener.ahead) == STEPS
    # The listener waits for a full window, which the player cannot pass.
    assert max(listener.ahead) == window
    wait_until(lambda: listener.states[-1]["state"] == "finished", "the last status")
    assert listener.states[-1]["sent stereo/features"] == str(STEPS)
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
    wait_until(lambda: len(listener.heard[FEATURES.recorded]) == STEPS, "the features")


def test_a_part_of_the_bag_comes_with_the_latched_messages_from_before(listen, make_player, bag):
    listener = listen()
    part = dataclasses.replace(FULL_SPEED, start_offset=2.0, duration=1.0)
    make_player(part).play()
    for topic in LATCHES:
        heard = listener.heard[topic.recorded]
        wait_until(lambda h=heard: h, topic.name)
        assert heard == recorded(bag, topic.recorded)
    expected = recorded(
        bag, FEATURES.recorded, start_offset=2_000_000_000, stop_offset=3_000_000_000
    )
    assert 9 <= len(expected) <= 11
    wait_until(lambda: len(listener.heard[FEATURES.recorded]) >= len(expected), "the features")
    assert listener.heard[FEATURES.recorded] == expected


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ({"start_offset": 100.0}, r"--start-offset 100 is past its end: it lasts \d+\.\d+ s"),
        ({"duration": 0.0}, "--duration 0 plays nothing"),
        ({"duration": -1.0}, "--duration -1 plays nothing"),
    ],
)
def test_a_part_that_the_bag_has_not_is_refused(make_player, bag, part, reason):
    with pytest.raises(VislamError, match=reason) as error:
        make_player(dataclasses.replace(FULL_SPEED, **part))
    assert str(error.value).startswith(f"{bag.path}: ")


def test_the_last_moment_of_the_bag_is_a_part_of_it(make_player, bag):
    last = dataclasses.replace(FULL_SPEED, start_offset=bag.duration / 1e9, wait=0.0)
    report = make_player(last).play()
    assert report.messages > len(LATCHES)
    assert report.state == "finished"


def test_a_loop_sends_the_same_stamps_again(listen, make_player, bag):
    listener = listen()
    report = make_player(dataclasses.replace(FULL_SPEED, passes=2)).play()
    assert (report.passes, report.state) == (2, "finished")
    sent = recorded(bag, FEATURES.recorded)
    wait_until(lambda: len(listener.heard[FEATURES.recorded]) >= 2 * STEPS, "both passes")
    assert listener.heard[FEATURES.recorded] == sent + sent


def test_only_the_chosen_topics_are_played_and_under_their_new_names(listen, make_player, bag):
    listener = listen(topics=[])
    listener.listen(TWIST, "/car/twist")
    options = dataclasses.replace(
        FULL_SPEED, topics=(TWIST.name,), remap=("/imu/twist:=/car/twist",)
    )
    report = make_player(options).play()
    assert report.messages == STEPS
    wait_until(lambda: len(listener.heard["/car/twist"]) >= STEPS, "the twists")
    assert listener.heard["/car/twist"] == recorded(bag, TWIST.recorded)


def test_a_bag_is_played_into_the_namespace_of_a_robot(listen, make_player, bag):
    listener = listen(topics=[])
    listener.listen(TWIST, "/car/imu/twist")
    options = dataclasses.replace(FULL_SPEED, topics=(TWIST.name,), namespace="car")
    node = make_player(options)
    assert node.play().state == "finished"
    wait_until(lambda: len(listener.heard["/car/imu/twist"]) >= STEPS, "the twists")
    assert listener.heard["/car/imu/twist"] == recorded(bag, TWIST.recorded)
    assert node.get_fully_qualified_name() == "/car/player"


def test_what_nobody_took_is_told(listen, make_player):
    listener = listen(topics=[TWIST])
    topics = (TWIST.name, IMU.name, FEATURES.name)
    report = make_player(dataclasses.replace(FULL_SPEED, topics=topics, wait=0.5)).play()
    assert report.delivered
    assert report.untaken == {IMU.recorded: STEPS, FEATURES.recorded: STEPS}
    wait_until(lambda: len(listener.heard[TWIST.recorded]) == STEPS, "the twists")


def test_latched_messages_are_taken_by_who_comes_before_the_end(listen, make_player, bag):
    node = make_player(dataclasses.replace(FULL_SPEED, wait=0.0, topics=(LATCHES[0].name,)))
    node.clock.pause()
    node.clock.step()
    listen(topics=[LATCHES[0]])
    assert node.play().untaken == {}


def test_a_topic_that_the_bag_does_not_have_is_an_error_with_a_choice(make_player):
    with pytest.raises(VislamError, match=r"no topic /imu/mag: choose from .*/imu/twist"):
        make_player(dataclasses.replace(FULL_SPEED, topics=("imu/mag",)))


def test_a_topic_whose_type_is_not_installed_is_left_out(make_player, bag, monkeypatch):
    def find(msgtype, find=outlets.message_class):
        return None if msgtype.startswith("sensor_msgs/msg/Imu") else find(msgtype)

    monkeypatch.setattr(outlets, "message_class", find)
    counts = Counter({connection.topic: connection.count for connection in bag.connections})
    topics = tuple(topic.recorded for topic in (*STREAMS, *LATCHES))
    played = [topic for topic in topics if topic != IMU.recorded]
    options = dataclasses.replace(FULL_SPEED, wait=0.0, topics=topics)
    assert make_player(options).play().messages == sum(counts[topic] for topic in played)


def clock_stamp(message):
    return message.clock.sec * 1_000_000_000 + message.clock.nanosec


def test_bytes_that_are_no_message_are_sent_as_they_are(listen, make_player, bag_path, tmp_path):
    (tmp_path / "bag").symlink_to(bag_path)
    change = changing(FEATURES, lambda index, message: JUNK if index == 3 else message)
    listener = listen(topics=[TWIST, FEATURES])
    with BagMessages(rewritten(tmp_path / "bag", change)) as junk_bag:
        assert make_player(FULL_SPEED, junk_bag).play().state == "finished"
    heard = listener.heard[FEATURES.recorded]
    wait_until(lambda: len(heard) == STEPS, "the features")
    assert heard[3] == JUNK


def test_the_ros_clock_is_the_bags_time(listen, make_player, bag):
    listener = listen(topics=[TWIST, FEATURES, CLOCK])
    make_player(dataclasses.replace(FULL_SPEED, rate=10.0, clock_rate=50.0)).play()
    wait_until(lambda: len(listener.heard[FEATURES.recorded]) == STEPS, "the features")
    stamps = [clock_stamp(deserialize_message(data, Clock)) for data in listener.heard[CLOCK.name]]
    inside = [stamp for stamp in stamps if bag.start <= stamp <= bag.end]
    assert len(inside) > 3
    assert inside == sorted(inside)
