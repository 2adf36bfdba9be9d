# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One verdict on every message, of ``vislam solve`` and of the nodes that are sent its bytes."""

import json
import time

import numpy as np
import pytest
import threadpoolctl
from faulty_bags import FAULTS, FRAMES, HOPELESS, NO_STEP, K, from_on, move
from rclpy.serialization import serialize_message
from rclpy.task import Future
from rewriting import rewritten, unchanged
from std_srvs.srv import Trigger

from vislam_ros.cli.main import main
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    FEATURES,
    GYRO_BIAS,
    IMU,
    LANDMARKS,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    STEPS,
    TOPICS,
    TWIST,
)
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.results.writer import pass_directories
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions, recorder_node
from vislam_ros.nodes.imu_prediction_node import ImuPredictionNode
from vislam_ros.nodes.recorder_node import RecorderNode
from vislam_ros.nodes.slam_node import SlamNode

SECOND = 1_000_000_000
WAIT = 30.0
TOLD = ("steps", "complete", "incomplete_reason", "verdict", "verdict_reasons")


@pytest.fixture(scope="module")
def good_bag(tmp_path_factory):
    drive = simulate(SimulationSettings(steps=FRAMES, landmarks=120)).drive
    path = tmp_path_factory.mktemp("verdicts") / "good"
    write_bag(drive, path)
    return path


@pytest.fixture
def faulty(good_bag, tmp_path):
    """Write the good bag anew with a change."""
    (tmp_path / "good").symlink_to(good_bag)
    return lambda change, **how: rewritten(tmp_path / "good", change, **how)


@pytest.fixture
def offline(tmp_path, capsys):
    """Solve a bag; gives the exit code, the last line on stderr and the results."""

    def offline(bag, *flags):
        code = main(["solve", str(bag), "--out", str(tmp_path / "solved"), *flags])
        lines = capsys.readouterr().err.splitlines()
        errors = [line for line in lines if not line.startswith(("wrote ", "next: "))]
        return code, errors[-1] if errors else "", results(tmp_path / "solved")

    return offline


@pytest.fixture
def live(make_node, capture, tmp_path, monkeypatch):
    """Send a bag's bytes to the nodes, and what they publish from one to the next."""
    monkeypatch.setattr(recorder_node, "ANSWER_SECONDS", 0.0)

    @threadpoolctl.threadpool_limits.wrap(limits=1)  # as slam_node: it decides the last digits
    def live(bag, **parameters):
        imu = make_node(ImuPredictionNode, **parameters)
        slam = make_node(SlamNode)
        recorder = make_node(RecorderNode, directory=str(tmp_path / "run"), record_mcap=False)
        published = {node: capture(node) for node in (imu, slam)}
        heard = {
            imu: (TWIST, IMU),
            slam: (*CALIBRATION_TOPICS, FEATURES, PREDICTION),
            recorder: (ODOMETRY, STEPS, GYRO_BIAS, PREDICTION, LANDMARKS, DIAGNOSTICS),
        }

        def send(topic, data):
            for node, topics in heard.items():
                if topic in topics:
                    node.monitor.take(topic, data)
            hand_on()

        def hand_on():
            for topics in published.values():
                for topic in (PREDICTION, ODOMETRY, STEPS, GYRO_BIAS, LANDMARKS, DIAGNOSTICS):
                    while topics[topic.recorded]:
                        send(topic, serialize_message(topics[topic.recorded].pop(0)))

        def publish_map(_request):
            answer = Future()
            try:
                answer.set_result(Trigger.Response(success=True, message=slam.publish_landmarks()))
            except VislamError as error:
                answer.set_result(Trigger.Response(success=False, message=str(error)))
            hand_on()
            return answer

        monkeypatch.setattr(recorder._map._client, "service_is_ready", lambda: True)
        monkeypatch.setattr(recorder._map._client, "call_async", publish_map)
        known = {topic.recorded: topic for topic in TOPICS}
        sent = dict.fromkeys((IMU, TWIST, FEATURES), 0)
        with BagMessages(bag) as messages:
            for item, _, data in messages.messages():
                topic = known[item.topic]
                sent[topic] = sent.get(topic, 0) + 1
                send(topic, bytes(data))
        for node in (imu, slam):
            node.monitor.report()
        hand_on()
        values = {"state": "finished", **{f"sent {topic.name}": n for topic, n in sent.items()}}
        recorder.monitor.take(PLAYER, serialize_message(player_status(values)))
        deadline = time.monotonic() + WAIT
        while not recorder.recording.finished:
            assert time.monotonic() < deadline
            recorder.on_tick()
        assert not recorder.monitor.refused.counts
        return results(tmp_path / "run")

    return live


def player_status(values):
    stamp = conversions.stamp_to_message(0)
    return conversions.status_array(stamp, [conversions.status("player", values)])


def results(directory):
    """What a run says of itself, and the bytes of its trajectories, of each pass."""
    told = []
    for folder in pass_directories(directory) if directory.exists() else []:
        summary = json.loads((folder / "summary.json").read_text())
        files = [folder / name for name in ("trajectory.tum", "dead_reckoning.tum")]
        told.append(
            {
                **{name: summary[name] for name in TOLD},
                "refused": summary["refused"],
                "refused_first": summary["refused_first"],
                "bytes": [file.read_bytes() if file.exists() else b"" for file in files],
            }
        )
    return told


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_message_gets_the_same_verdict_live_and_offline(faulty, offline, live, fault):
    change, refused = FAULTS[fault]
    bag = faulty(change)
    code, line, solved = offline(bag)
    assert code == 0
    (told,) = solved
    assert told["refused"] == refused
    assert told["complete"] is True
    assert told["steps"] > 0
    for word, count in refused.items():
        assert f"{count} {word} (" in line
    assert live(bag) == solved


def test_stamps_that_begin_anew_make_a_second_pass_live_and_offline(faulty, offline, live):
    bag = faulty(from_on([IMU, TWIST, FEATURES], FRAMES // 2, move(-50.0)))
    code, _, solved = offline(bag)
    assert code == 0
    assert [told["steps"] for told in solved] == [FRAMES // 2, FRAMES - FRAMES // 2]
    assert all(told["complete"] for told in solved)
    assert live(bag) == solved


@pytest.mark.parametrize("fault", NO_STEP)
def test_a_run_without_a_step_is_incomplete_and_names_the_refusals(faulty, offline, live, fault):
    change, refused = NO_STEP[fault]
    bag = faulty(change)
    code, line, solved = offline(bag)
    assert code == 1
    (told,) = solved
    assert (told["complete"], told["refused"]) == (False, refused)
    assert line.startswith("error: ")
    assert "solved: incomplete: not one step: " in line
    for word, count in refused.items():
        assert f"{count} {word} (" in line
    assert live(bag) == solved


@pytest.mark.parametrize("topic", [TWIST, FEATURES], ids=["twist", "features"])
def test_only_what_comes_late_is_used_offline_and_refused_live(faulty, offline, live, topic):
    """It cannot be otherwise, for live the newer one is used by then."""

    def swap(name, index, time):
        return time + (name == topic.recorded and index == K) * round(0.15 * SECOND)

    bag = faulty(unchanged, log_time=swap)
    code, _, solved = offline(bag)
    assert (code, solved[0]["steps"], solved[0]["refused"]) == (0, FRAMES, {})
    (told,) = live(bag)
    assert told["complete"] is True
    assert told["refused"] == {f"{topic.stream.value}_late": 1}
    assert told["steps"] == FRAMES - (topic is FEATURES)


def test_turns_of_the_imu_are_taken_live_and_offline(faulty, offline, live, tmp_path):
    def change(topic, index, message):
        if topic == IMU.recorded:
            message.angular_velocity.z += 0.01
            if index == K:
                message.angular_velocity_covariance = np.array([-1.0, *[0.0] * 8])
        return message

    params = tmp_path / "params.yaml"
    params.write_text("imu_prediction_node: {ros__parameters: {angular_velocity_source: imu}}\n")
    bag = faulty(change)
    code, _, solved = offline(bag, "--params", str(params))
    assert code == 0
    assert solved[0]["refused"] == {"imu_absent_field": 1, "twist_unpaired": 1}
    assert live(bag, angular_velocity_source="imu") == solved


@pytest.mark.parametrize("fault", HOPELESS)
def test_a_bag_without_a_usable_message_fails_at_once_in_the_same_words(
    faulty, offline, tmp_path, capsys, fault
):
    change, words = HOPELESS[fault]
    bag = faulty(change)
    code, line, solved = offline(bag)
    assert (code, solved) == (1, [])
    for word in words:
        assert word in line
    assert main(["run", str(bag), "--out", str(tmp_path / "run")]) == 1
    assert capsys.readouterr().err.splitlines() == [line]
    assert not (tmp_path / "run").exists()
