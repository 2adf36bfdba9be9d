# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One verdict on every message, of ``vislam solve`` and of the nodes that are sent its bytes."""

import copy
import json
import time

import numpy as np
import pytest
import threadpoolctl
from rclpy.serialization import serialize_message
from rewriting import JUNK, changing, edit, rewritten, unchanged

from vislam_ros.cli.main import main
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    EXTRINSICS,
    FEATURES,
    GYRO_BIAS,
    IMU,
    LANDMARKS,
    LEFT_CAMERA,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    RIGHT_CAMERA,
    STEPS,
    TOPICS,
    TWIST,
)
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.results.writer import pass_directories
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.nodes import conversions, recorder_node
from vislam_ros.nodes.imu_prediction_node import ImuPredictionNode
from vislam_ros.nodes.recorder_node import RecorderNode
from vislam_ros.nodes.slam_node import SlamNode

FRAMES, K = 14, 6
SECOND = 1_000_000_000
WAIT = 30.0


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
        errors = capsys.readouterr().err.splitlines()
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
            imu: (TWIST, IMU) if parameters else (TWIST,),
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
            slam.publish_landmarks()
            hand_on()

        monkeypatch.setattr(recorder._map_client, "service_is_ready", lambda: True)
        monkeypatch.setattr(recorder._map_client, "call_async", publish_map)
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
                **{name: summary[name] for name in ("steps", "complete", "incomplete_reason")},
                "refused": summary["refused"],
                "refused_first": summary["refused_first"],
                "bytes": [file.read_bytes() if file.exists() else b"" for file in files],
            }
        )
    return told


def put_nan(cloud):
    cloud.data = cloud.data.copy()
    cloud.data[4:8] = 255


def repeat_point(cloud):
    cloud.data = np.concatenate([cloud.data, cloud.data[-20:]])
    cloud.width += 1
    cloud.row_step += 20


def turn_points_round(cloud):
    cloud.data = cloud.data.reshape(-1, 20)[::-1].ravel()


def set_frame(message):
    message.header.frame_id = "elsewhere"


def move(seconds):
    def move(message):
        stamp = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
        stamp += round(seconds * SECOND)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)

    return move


def at(topic, index, told):
    """A change: another thing stands for one message."""
    return changing(topic, lambda place, message: told(message) if place == index else message)


def twice(message):
    return [message, message]


def from_on(topics, index, action):
    """A change in place of all messages of some topics from one on."""
    names = {topic.recorded for topic in topics}

    def change(name, place, message):
        if name in names and place >= index:
            action(message)
        return message

    return change


def followed_by(topic, action):
    """A change: a good calibration message, and then a spoilt one like it."""

    def told(message):
        spoilt = copy.deepcopy(message)
        action(spoilt)
        return [message, spoilt]

    return at(topic, 0, told)


def put_p(place, value):
    def put(info):
        info.p = info.p.copy()
        info.p[place] += value

    return put


def spoil_rotation(transform):
    transform.transform.rotation.w += 1.0


def put_twist_nan(message):
    message.twist.twist.angular.z = float("nan")


FAULTS = {
    "nothing": (unchanged, {}),
    "points in another order": (edit(FEATURES, K, turn_points_round), {}),
    "a pixel is not finite": (edit(FEATURES, K, put_nan), {"features_non_finite": 1}),
    "a cloud is too short": (
        edit(FEATURES, K, lambda cloud: setattr(cloud, "width", cloud.width + 1)),
        {"features_wrong_size": 1},
    ),
    "a field is missing": (
        edit(FEATURES, K, lambda cloud: setattr(cloud, "fields", cloud.fields[:-1])),
        {"features_bad_fields": 1},
    ),
    "double ids in three clouds": (
        from_on([FEATURES], FRAMES - 3, repeat_point),
        {"features_duplicate_ids": 3},
    ),
    "features of another frame": (edit(FEATURES, K, set_frame), {"features_unknown_frame": 1}),
    "features from before 1970": (edit(FEATURES, K, move(-3e9)), {"features_before_1970": 1}),
    "features that are no message": (at(FEATURES, K, lambda _: JUNK), {"features_undecodable": 1}),
    "features sent twice": (at(FEATURES, K, twice), {"features_duplicate": 1}),
    "the first frame has no motion": (
        changing(TWIST, lambda place, message: message if place else None),
        {"features_no_prediction": 1},
    ),
    "all frames lie behind their motion": (
        from_on([FEATURES], 0, move(0.005)),
        {"features_no_prediction": 1},
    ),
    "a twist is not finite": (edit(TWIST, K, put_twist_nan), {"twist_non_finite": 1}),
    "a twist of another frame": (edit(TWIST, K, set_frame), {"twist_unknown_frame": 1}),
    "a twist from before 1970": (edit(TWIST, K, move(-3e9)), {"twist_before_1970": 1}),
    "a twist that is no message": (at(TWIST, K, lambda _: JUNK), {"twist_undecodable": 1}),
    "a twist sent twice": (at(TWIST, K, twice), {"twist_duplicate": 1}),
    "a lost twist": (at(TWIST, K, lambda _: None), {}),
    "a twist from long ago": (
        edit(TWIST, K, move(-100.0)),
        {"features_no_prediction": FRAMES - K},
    ),
    "the right camera is off by a rounding": (edit(RIGHT_CAMERA, 0, put_p(2, 1e-9)), {}),
    "a camera info that is no pair": (
        followed_by(RIGHT_CAMERA, put_p(0, 1.0)),
        {"camera_info_not_a_pair": 1},
    ),
    "a camera info that is not finite": (
        followed_by(LEFT_CAMERA, put_p(0, float("nan"))),
        {"camera_info_non_finite": 1},
    ),
    "extrinsics that are no rotation": (
        followed_by(EXTRINSICS, spoil_rotation),
        {"extrinsics_not_a_rotation": 1},
    ),
    "extrinsics of other frames": (
        followed_by(EXTRINSICS, set_frame),
        {"extrinsics_unknown_frame": 1},
    ),
}


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


NO_STEP = {
    "all stamps are zero": (
        from_on([TWIST], 0, lambda m: setattr(m.header, "stamp", type(m.header.stamp)(0, 0))),
        {"twist_duplicate": FRAMES - 1, "features_no_prediction": FRAMES},
    ),
    "all frames lie before their motion": (
        from_on([FEATURES], 0, move(-10.0)),
        {"features_no_prediction": FRAMES},
    ),
}


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


def rename_frames(_topic, _index, message):
    names = {"base_link": "car", "camera_left_optical": "cam"}
    for holder, name in (
        (getattr(message, "header", None), "frame_id"),
        (message, "child_frame_id"),
    ):
        if hasattr(holder, name):
            setattr(holder, name, names.get(getattr(holder, name), "map"))
    return message


HOPELESS = {
    "frames are named otherwise": (
        rename_frames,
        ["header.frame_id is 'car'", "base_frame", "header.frame_id is 'cam'", "camera_frame"],
    ),
    "no twist is a message": (
        changing(TWIST, lambda _, __: JUNK),
        ["no usable message on /imu/twist: its bytes are no message"],
    ),
    "the cameras are no pair": (
        edit(RIGHT_CAMERA, 0, put_p(0, 1.0)),
        ["/stereo/right/camera_info", "field p differs"],
    ),
    "the extrinsics are no rotation": (
        edit(EXTRINSICS, 0, spoil_rotation),
        ["no usable message on /stereo/extrinsics: its quaternion"],
    ),
    "no cloud has the ids": (
        from_on([FEATURES], 0, lambda cloud: setattr(cloud, "fields", cloud.fields[1:])),
        ["no usable message on /stereo/features: ", "no field 'id'"],
    ),
}


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
