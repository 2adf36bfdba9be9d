# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The nodes as processes: how they start, how they end, and a whole run of all three."""

import functools
import json
import shutil
import signal
from contextlib import suppress

import pytest
import threadpoolctl
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from live.node_processes import WAIT, spin_until, wait_until
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    DIAGNOSTICS,
    FEATURES,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    STEPS,
    TWIST,
)
from vislam_ros.data.trajectory import tum_line
from vislam_ros.nodes import conversions
from vislam_ros.nodes.spin import LAST
from vislam_ros.nodes.topics import LATCHED, STREAM, message_class


@pytest.fixture
def probe(make_node):
    class Probe(Node):
        def __init__(self, **options):
            super().__init__("probe", **options)

    return make_node(Probe)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-p", "velocity_noise_std:=-1.0"), ("velocity_noise_std", "-1.0")),
        (("-p", "time_jump:=soon"), ("time_jump", "soon")),
        (("-p", "use_sim_time:=7"), ("use_sim_time", "7")),
        (("-p", "qos_overrides./diagnostics.publisher.history:=last"), ("/diagnostics", "last")),
        (("--params-file", "/nowhere.yaml"), ("/nowhere.yaml",)),
        (("--no-such-argument",), ("--no-such-argument",)),
    ],
)
def test_a_node_that_cannot_start_says_why_in_one_line(processes, arguments, words):
    code, lines = processes.run_to_end("nodes.imu_prediction_node", "--ros-args", *arguments)
    assert code == 1
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize("arguments", [("drive_bag",), ("--rate",), ("-p", "time_jump:=2.0")])
def test_a_node_refuses_what_ros_would_pass_over_in_silence(processes, arguments):
    code, lines = processes.run_to_end("nodes.imu_prediction_node", *arguments)
    assert code == 1
    assert lines == [f"error: arguments outside --ros-args: {' '.join(arguments)}; see --help"]


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_a_node_tells_how_it_is_started(processes, flag):
    process = processes.start("nodes.imu_prediction_node", flag)
    words, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 0, errors
    assert words.startswith("usage: imu_prediction_node [--ros-args ")


@pytest.mark.parametrize(
    "signals", [[signal.SIGINT], [signal.SIGTERM], [LAST], [signal.SIGINT] * 3]
)
def test_signals_end_a_node_with_0_and_without_a_traceback(processes, probe, signals):
    process = processes.start("nodes.imu_prediction_node", "--ros-args", "-p", "time_jumb:=2.0")
    wait_until(lambda: probe.count_subscribers(TWIST.name), "the start of the node")
    for number in signals:
        with suppress(ProcessLookupError):
            process.send_signal(number)
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert "time_jumb: no such parameter, it has no effect; did you mean time_jump?" in errors


def test_a_request_that_ros_does_not_understand_ends_no_node(processes, probe):
    process = processes.start("nodes.slam_node")
    executor = SingleThreadedExecutor(context=probe.context)
    executor.add_node(probe)
    client = probe.create_client(SetParameters, "/slam_node/set_parameters")
    spin_until(executor, client.service_is_ready, "the service")

    def ask(value):
        parameter = Parameter(name="chi2_gate", value=value)
        return client.call_async(SetParameters.Request(parameters=[parameter]))

    bad = [ask(ParameterValue(type=77)) for _ in range(3)]
    good = ask(ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=9.0))
    spin_until(executor, good.done, "the answer after those")
    assert good.result().results[0].successful
    assert all(each.done() and not each.result().results for each in bad)
    executor.shutdown()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert errors.count("77 is not a valid") == 1


def test_a_recorder_that_cannot_write_any_more_says_why_without_a_traceback(
    processes, probe, tmp_path
):
    directory = tmp_path / "recorded"
    process = processes.start("nodes.recorder_node", "--ros-args", "-p", f"directory:={directory}")
    wait_until(lambda: probe.count_subscribers(ODOMETRY.name), "the start of the node")
    shutil.rmtree(directory.rename(tmp_path / "deleted"))
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 1
    assert "Traceback" not in errors
    assert "Exception" not in errors
    assert errors.splitlines()[-1].startswith(f"error: {directory}")


class Source(Node):
    """Plays the small drive."""

    def __init__(self, **options):
        super().__init__("source", **options)
        self.twists = self.create_publisher(TwistWithCovarianceStamped, TWIST.name, STREAM)
        self.features = self.create_publisher(PointCloud2, FEATURES.name, STREAM)
        self.calibration = {
            topic: self.create_publisher(message_class(topic.msgtype), topic.name, LATCHED)
            for topic in CALIBRATION_TOPICS
        }
        self.status = self.create_publisher(DiagnosticArray, PLAYER.name, LATCHED)
        self.subscribers = {}
        self.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self.on_diagnostics, STREAM)

    def on_diagnostics(self, message):
        for status in message.status:
            for entry in status.values:
                if entry.key.startswith("subscribers "):
                    self.subscribers[entry.key] = int(entry.value)

    def graph_is_whole(self):
        return (
            self.twists.get_subscription_count() == 1
            and self.features.get_subscription_count() == 1
            and self.subscribers.get(f"subscribers {PREDICTION.name}") == 2
            and self.subscribers.get(f"subscribers {ODOMETRY.name}") == 1
            and self.subscribers.get(f"subscribers {STEPS.name}") == 1
        )

    def play(self, drive):
        for topic, message in drive.calibration:
            self.calibration[topic].publish(message)
        for twist, features in zip(drive.twists, drive.features, strict=True):
            self.twists.publish(twist)
            self.features.publish(features)

    def tell(self, state, sent):
        values = {"state": state, f"sent {FEATURES.name}": sent, f"sent {TWIST.name}": sent}
        self.status.publish(
            conversions.status_array(
                conversions.stamp_to_message(0), [conversions.status("player", values)]
            )
        )


@threadpoolctl.threadpool_limits.wrap(limits=1)  # as slam_node: it decides the last digits
def expected_trajectory(drive):
    prediction, slam = DeadReckoning(PredictionSettings()), Slam(SlamSettings())
    slam.set_camera(drive.camera)
    steps = []
    for twist, features in zip(drive.twists, drive.features, strict=True):
        for pose in prediction.add_twist(*decoding.twist(twist, DEFAULT_FRAMES)):
            steps += slam.add_prediction(pose.stamp, pose.position, pose.quaternion)
        steps += slam.add_features(*decoding.features(features, DEFAULT_FRAMES))
    return "".join(f"{tum_line(s.stamp, s.position, s.quaternion)}\n" for s in steps)


@pytest.fixture
def graph(processes, make_node, context, tmp_path):
    """The three nodes, discovered, and a source that plays to them."""
    directory = tmp_path / "run"
    source = make_node(Source)
    nodes = {
        "imu_prediction_node": processes.start("nodes.imu_prediction_node"),
        "slam_node": processes.start("nodes.slam_node"),
        "recorder_node": processes.start(
            "nodes.recorder_node", "--ros-args", "-p", f"directory:={directory}"
        ),
    }
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(source)

    spin_until(executor, source.graph_is_whole, "the discovery of the graph")
    yield source, nodes, directory, functools.partial(spin_until, executor)
    executor.shutdown()


def test_a_run_of_the_whole_graph_gives_the_offline_trajectory(graph, drive):
    source, nodes, directory, spin_until = graph
    source.play(drive)
    source.tell("finished", len(drive.features))
    summary = directory / "summary.json"
    spin_until(
        lambda: summary.is_file() and json.loads(summary.read_text())["complete"],
        "the end of the run",
    )
    for process in nodes.values():
        process.send_signal(signal.SIGINT)
    for name, process in nodes.items():
        _, errors = process.communicate(timeout=WAIT)
        assert process.returncode == 0, f"{name}: {errors}"
        assert "Traceback" not in errors
    assert (directory / "trajectory.tum").read_text() == expected_trajectory(drive)
    parameters = (directory / "params.yaml").read_text()
    for name in nodes:
        assert f"{name}:" in parameters
    assert json.loads(summary.read_text())["estimator"] == SlamSettings().estimator


def test_a_killed_recorder_leaves_all_but_the_last_second(graph, drive):
    source, nodes, directory, spin_until = graph
    source.play(drive)
    spin_until(
        lambda: (
            count_messages(directory / "results.mcap", ODOMETRY.recorded) == len(drive.features)
        ),
        "the writing of all messages while the recorder runs",
    )
    nodes["recorder_node"].kill()
    nodes["recorder_node"].communicate(timeout=WAIT)
    assert (directory / "trajectory.tum").read_text() == expected_trajectory(drive)
    assert json.loads((directory / "summary.json").read_text())["complete"] is False
    assert count_messages(directory / "results.mcap", ODOMETRY.recorded) == len(drive.features)


def count_messages(path, topic):
    count = 0
    if path.is_file():
        with path.open("rb") as file, suppress(EndOfFile):
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                count += channel.topic == topic
    return count
