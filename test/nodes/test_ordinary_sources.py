# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Robots as they come, live and without a player: whatever they send, it is recorded whole."""

import dataclasses
import itertools
import json
import signal

import numpy as np
import pytest
import threadpoolctl
from diagnostic_msgs.msg import DiagnosticArray
from live.node_processes import WAIT, spin_until
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    EXTRINSICS,
    FEATURES,
    LEFT_CAMERA,
    ODOMETRY,
    PREDICTION,
    RIGHT_CAMERA,
    TWIST,
)
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import tum_line
from vislam_ros.nodes.player.graph import GraphWatch
from vislam_ros.nodes.topics import LATCHED, STREAM, message_class

FRAMES = 25
NODES = ("imu_prediction_node", "slam_node", "recorder_node")

# A driver's camera infos: sent with each frame, kept for nobody.
REPEATED = QoSProfile(
    depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
)
AS_DRIVERS_DO = {
    TWIST: qos_profile_sensor_data,
    FEATURES: qos_profile_sensor_data,
    **dict.fromkeys(CALIBRATION_TOPICS, REPEATED),
    EXTRINSICS: LATCHED,
}
RELIABLE = {TWIST: STREAM, FEATURES: STREAM, **dict.fromkeys(CALIBRATION_TOPICS, LATCHED)}


def drive_at(rate):
    """A drive at 10 Hz whose twists come at another rate (Hz), and not at the frames' stamps."""
    drive = simulate(SimulationSettings(steps=FRAMES, landmarks=120)).drive
    begin, end = drive.twist_stamps[0], drive.twist_stamps[-1]
    period = round(1e9 / rate)
    stamps = np.arange(begin - period // 3, end + 45 * period, period)
    nearest = np.clip(np.searchsorted(drive.twist_stamps, stamps), 0, FRAMES - 1)
    return dataclasses.replace(drive, twist_stamps=stamps, twists=drive.twists[nearest])


@threadpoolctl.threadpool_limits.wrap(limits=1)  # as slam_node: it decides the last digits
def offline_lines(drive):
    trajectory = solve(drive).trajectory
    poses = zip(trajectory.stamps, trajectory.positions, trajectory.quaternions, strict=True)
    return [tum_line(int(stamp), *pose) for stamp, *pose in poses]


class Robot(Node):
    """Sends a drive from its sensors, each in its own time, and hears what comes of it."""

    def __init__(self, path, drive, qos, **options):
        super().__init__("robot", **options)
        write_bag(drive, path)
        with BagMessages(path) as bag:
            self._messages = {
                topic: [
                    deserialize_message(data, message_class(topic.msgtype))
                    for _, _, data in bag.messages([topic.recorded])
                ]
                for topic in qos
            }
        self._outlets = {
            topic: self.create_publisher(message_class(topic.msgtype), topic.name, profile)
            for topic, profile in qos.items()
        }
        self.drive = drive
        self.predicted, self.answered = set(), set()
        self.create_subscription(Odometry, PREDICTION.name, self._note(self.predicted), STREAM)
        self.create_subscription(Odometry, ODOMETRY.name, self._note(self.answered), STREAM)
        self.taken = set()
        self.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self._note_taken, STREAM)
        self._graph = GraphWatch(self, lambda *_: None)

    def missing(self):
        """Links between the nodes that are not there yet, in words."""
        return self._graph.missing(whole=True)

    def _note(self, stamps):
        def note(message):
            stamps.add(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)

        return note

    def _note_taken(self, message):
        for status in message.status:
            if status.name.rpartition("/")[0] == self.get_namespace().rstrip("/"):
                values = {entry.key: entry.value for entry in status.values}
                topics = {key.removeprefix("received ") for key, n in values.items() if n != "0"}
                self.taken |= topics & {TWIST.name, FEATURES.name}

    def _send(self, topic, number):
        self._outlets[topic].publish(self._messages[topic][number])

    def sends(self):
        """Send the drive, frame by frame; at each ``yield`` there is something to wait for.

        Of best-effort messages those may be lost that come before the nodes have found their
        sender, so the first ones are sent again until they were taken.
        """
        self._send(EXTRINSICS, 0)
        twists, frames = self.drive.twist_stamps.tolist(), self.drive.feature_stamps.tolist()
        while TWIST.name not in self.taken:
            self._send(TWIST, 0)
            yield
        sent = 1
        for number, frame in enumerate(frames):
            while twists[sent - 1] < frame:
                batch = range(sent, sent + 40)
                for k in batch:
                    self._send(TWIST, k)
                while twists[batch[-1]] not in self.predicted:
                    yield
                sent = batch.stop
            for topic in (LEFT_CAMERA, RIGHT_CAMERA):
                self._send(topic, 0)
            self._send(FEATURES, number)
            # The first one is answered with the second, which confirms its stamp.
            while FEATURES.name not in self.taken:
                yield
                self._send(FEATURES, number)
            while number and not self.answered.issuperset(frames[: number + 1]):
                yield


@pytest.fixture
def robots(make_node, context, tmp_path):
    """Make robots that a test spins."""
    executor = SingleThreadedExecutor(context=context)

    def make(drive, qos, namespace):
        name = namespace.strip("/")
        robot = Robot(tmp_path / f"{name}_bag", drive, qos, context=context, namespace=namespace)
        executor.add_node(robot)
        made.append(robot)
        return robot

    made = []
    yield executor, make
    executor.shutdown()
    for robot in made:
        robot.destroy_node()


def start_nodes(processes, namespace, directory, *flags):
    return {
        name: processes.start(
            f"nodes.{name}",
            *("--ros-args", "-r", f"__ns:={namespace}", *flags),
            *(("-p", f"directory:={directory}") if name == "recorder_node" else ()),
        )
        for name in NODES
    }


def send_all(executor, *sending):
    """Go on with all that is sent, until it is."""
    waiting = list(sending)

    def are_done():
        waiting[:] = [one for one in waiting if next(one, True) is None]
        return not waiting

    spin_until(executor, are_done, "the end of the drives")


def summary_of(directory):
    return json.loads((directory / "summary.json").read_text())


def test_two_robots_are_recorded_side_by_side_each_whole_and_by_itself(
    robots, processes, tmp_path
):
    """One as drivers send, in simulated time that nobody tells, until its recorder is asked to
    finish. The other as this package's player, and it drives on while its recorder is told to end.
    """
    executor, make = robots
    one, two = tmp_path / "one", tmp_path / "two"
    flags = ("-p", "use_sim_time:=true")
    nodes = {
        "/robot1": start_nodes(processes, "/robot1", one, *flags),
        "/robot2": start_nodes(processes, "/robot2", two),
    }
    first = make(drive_at(1000.0), AS_DRIVERS_DO, "/robot1")
    second = make(drive_at(10.0), RELIABLE, "/robot2")
    for robot in (first, second):
        spin_until(executor, lambda r=robot: not r.missing(), "the discovery of the graph")
    second_sends = second.sends()
    send_all(
        executor,
        first.sends(),
        itertools.takewhile(lambda _: len(second.answered) < FRAMES // 2, second_sends),
    )

    finish = first.create_client(Trigger, "recorder_node/finish")
    spin_until(executor, finish.service_is_ready, "the service")
    answer = finish.call_async(Trigger.Request())
    nodes["/robot2"]["recorder_node"].send_signal(signal.SIGTERM)
    send_all(executor, second_sends)
    for namespace, directory, robot in (("/robot1", one, first), ("/robot2", two, second)):
        recorder = nodes[namespace]["recorder_node"]
        spin_until(executor, lambda r=recorder: r.poll() is not None, "the end of the recorder")
        _, errors = recorder.communicate(timeout=WAIT)
        assert recorder.returncode == 0, errors
        assert "Traceback" not in errors
        assert errors.splitlines()[-1].endswith(f"{directory}: complete")
        results = read_results(directory)
        assert results.summary["complete"] is True
        lines = (directory / "trajectory.tum").read_text().splitlines()
        assert lines == offline_lines(robot.drive)[: len(lines)]
        assert len(lines) >= (FRAMES if robot is first else FRAMES // 2)
        assert len(results.landmarks) == results.summary["landmarks"]
        assert set(NODES) <= results.parameters.keys()
        for other in NODES[:2]:
            assert nodes[namespace][other].poll() is None, other
    assert answer.result().success


def test_ctrl_c_to_the_whole_graph_keeps_all_poses_and_says_in_a_line_what_is_missing(
    robots, processes, tmp_path
):
    executor, make = robots
    directory = tmp_path / "run"
    nodes = start_nodes(processes, "/", directory)
    robot = make(drive_at(100.0), RELIABLE, "/")
    spin_until(executor, lambda: not robot.missing(), "the discovery of the graph")
    send_all(executor, robot.sends())
    for process in nodes.values():
        process.send_signal(signal.SIGINT)
    ends = {name: process.communicate(timeout=WAIT)[1] for name, process in nodes.items()}
    for name, errors in ends.items():
        assert nodes[name].returncode == 0, errors
        assert "Traceback" not in errors
    lines = (directory / "trajectory.tum").read_text().splitlines()
    assert lines == offline_lines(robot.drive)
    summary = read_results(directory).summary
    verdict = "complete" if summary["complete"] else f"incomplete: {summary['incomplete_reason']}"
    assert ends["recorder_node"].splitlines()[-1].endswith(f"{directory}: {verdict}")
    assert summary["incomplete_reason"] in (None, "the landmark map did not arrive")
