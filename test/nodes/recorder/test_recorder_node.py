# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder, told by its callbacks what the SLAM node's callbacks publish."""

import dataclasses
import functools
import shutil
import time
from collections import Counter
from contextlib import suppress

import numpy as np
import pytest
from live.recorder_messages import (
    answer_later,
    give,
    give_drive,
    give_map,
    give_player,
    give_step,
    summary,
    tick_until_finished,
)
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger

from vislam_ros.core.step import estimates_of
from vislam_ros.core.verdict.reason import Judgement, Word
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    GYRO_BIAS,
    LANDMARKS,
    ODOMETRY,
    PATH,
    PLAYER,
    PREDICTION,
    STATIC_TRANSFORMS,
    STEPS,
    TRANSFORMS,
)
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import read_tum, tum_line
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions, recorder_node
from vislam_ros.nodes.recorder.map_request import map_answer
from vislam_ros.nodes.recorder_node import RecorderNode
from vislam_ros.nodes.slam_report import verdict_values


def test_trajectory_is_the_core_s_byte_for_byte(recorder, drive, answers, tmp_path):
    give_drive(recorder, drive, answers)
    lines = [f"{tum_line(s.stamp, s.position, s.quaternion)}\n" for s in answers[0]]
    assert (tmp_path / "run" / "trajectory.tum").read_text() == "".join(lines)


def test_a_whole_run_is_complete_and_can_be_read(recorder, drive, answers, tmp_path, no_patience):
    steps, landmarks = answers
    give_player(recorder, "playing", 0)
    give_drive(recorder, drive, answers)
    give_player(recorder, "finished", len(steps))
    give_map(recorder, steps[-1].stamp, landmarks)
    tick_until_finished(recorder)

    results = read_results(tmp_path / "run")
    assert results.summary["complete"] is True
    assert results.summary["steps"] == len(steps)
    assert results.summary["latency_ms_p50"] == 1.5
    assert results.summary["gyro_bias"] == steps[-1].estimates[0].values.tolist()
    assert results.summary["estimates"] == estimates_of(steps[-1].row())
    assert len(results.dead_reckoning) == len(drive.predictions)
    np.testing.assert_array_equal(results.landmarks.ids, landmarks.ids)
    np.testing.assert_array_equal(results.landmarks.generations, landmarks.generations)
    np.testing.assert_allclose(
        results.covariances, [s.covariance for s in steps], rtol=1e-9, atol=1e-15
    )
    for name, column in results.steps.items():
        assert column.tolist() == [step.row()[name] for step in steps], name


def test_messages_are_kept_as_they_came_in_a_file_that_other_tools_open(
    recorder, drive, answers, tmp_path, no_patience
):
    steps, landmarks = answers
    give_player(recorder, "playing", 0)
    give_drive(recorder, drive, answers)
    give_map(recorder, steps[-1].stamp, landmarks)
    give_player(recorder, "finished", len(steps))
    tick_until_finished(recorder)
    with AnyReader([tmp_path / "run" / "results.mcap"]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        assert counts == {
            ODOMETRY.recorded: len(steps),
            STEPS.recorded: len(steps),
            GYRO_BIAS.recorded: len(steps),
            PREDICTION.recorded: len(steps),
            LANDMARKS.recorded: 1,
            PLAYER.recorded: 2,
            # Made for viewers, see test_scene.
            TRANSFORMS.recorded: 2 * len(steps),
            PATH.recorded: 3,
        }
        assert reader.start_time == steps[0].stamp
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == ODOMETRY.recorded:
                position = message.pose.pose.position
    assert (position.x, position.y, position.z) == tuple(steps[-1].position)


def test_the_camera_is_recorded_once_for_viewers_and_in_every_pass(
    recorder, drive, answers, tmp_path
):
    for _ in range(3):  # as those repeat it that send it with each frame
        for topic, message in drive.calibration:
            message.header.stamp.sec += 1
            give(functools.partial(recorder.on_calibration, topic), topic, message)
    give_drive(recorder, drive, answers)
    give_drive(recorder, drive, answers)
    recorder.destroy_node()
    for folder in ("", "pass_002"):
        with AnyReader([tmp_path / "run" / folder / "results.mcap"]) as reader:
            counts = {name: info.msgcount for name, info in reader.topics.items()}
            for topic in (*CALIBRATION_TOPICS, STATIC_TRANSFORMS):
                assert counts[topic.recorded] == 1
            (static,) = (c for c in reader.connections if c.topic == STATIC_TRANSFORMS.recorded)
            ((_, stamp, data),) = reader.messages([static])
            (transform,) = reader.deserialize(data, static.msgtype).transforms
        assert stamp == drive.stamps[0]
        assert transform.child_frame_id == "camera_left_optical"


def test_a_shortfall_is_named(recorder, drive, answers, tmp_path, no_patience):
    steps, landmarks = answers
    give_drive(recorder, drive, answers)
    give_map(recorder, steps[-1].stamp, landmarks)
    give_player(recorder, "finished", len(steps) + 3)
    tick_until_finished(recorder)
    told = summary(tmp_path / "run")
    assert told["complete"] is False
    assert told["incomplete_reason"] == (
        f"3 of {len(steps) + 3} features messages were not answered"
    )


@pytest.mark.parametrize(
    ("state", "give_the_map", "reason"),
    [
        ("interrupted", True, "the player was interrupted"),
        ("finished", False, "the landmark map did not arrive"),
    ],
)
def test_a_run_that_is_not_whole_says_why(
    recorder, drive, answers, tmp_path, no_patience, state, give_the_map, reason
):
    steps, landmarks = answers
    give_drive(recorder, drive, answers)
    if give_the_map:
        give_map(recorder, steps[-1].stamp, landmarks)
    give_player(recorder, state, len(steps))
    tick_until_finished(recorder)
    assert summary(tmp_path / "run")["incomplete_reason"] == reason


def test_a_recorder_that_is_stopped_leaves_incomplete_but_readable_results(
    recorder, drive, answers, tmp_path
):
    give_player(recorder, "playing", 3)
    give_drive(recorder, drive, answers)
    recorder.finish()
    recorder.destroy_node()
    told = summary(tmp_path / "run")
    assert told["complete"] is False
    assert "playing" in told["incomplete_reason"]
    with AnyReader([tmp_path / "run" / "results.mcap"]) as reader:
        made = (PATH.recorded, TRANSFORMS.recorded)
        counts = {name: info.msgcount for name, info in reader.topics.items()}
        others = sum(count for name, count in counts.items() if name not in made)
        assert others == 4 * len(drive.stamps) + 1


def test_nothing_of_the_last_flush_is_lost_to_a_kill(recorder, drive, answers, tmp_path):
    """What is on disk after a flush is what a kill leaves."""
    steps, landmarks = answers
    give_drive(recorder, drive, answers)
    give_map(recorder, steps[-1].stamp, landmarks)
    recorder.flush()
    killed = shutil.copytree(tmp_path / "run", tmp_path / "killed")

    np.testing.assert_array_equal(read_tum(killed / "trajectory.tum").stamps, drive.stamps)
    assert len(read_landmarks(killed / "landmarks.npz")) == len(landmarks)
    assert summary(killed)["complete"] is False
    seen = Counter()
    with (killed / "results.mcap").open("rb") as file, suppress(EndOfFile):
        reader = NonSeekingReader(file)
        for schema, channel, _ in reader.iter_messages(log_time_order=False):
            assert schema.data
            seen[channel.topic] += 1
    assert seen[ODOMETRY.recorded] == seen[STEPS.recorded] == len(steps)
    assert seen[LANDMARKS.recorded] == 1


def test_a_loop_goes_to_directories_of_its_own(
    recorder, drive, answers, tmp_path, no_patience, capfd
):
    steps, landmarks = answers
    for _ in range(3):
        # The prediction runs ahead of the filter, over the jump too.
        for prediction in drive.predictions:
            give(recorder.on_prediction, PREDICTION, prediction)
    for _ in range(3):
        for step in steps:
            give_step(recorder, step)
        give_map(recorder, steps[-1].stamp, landmarks)
        recorder.on_tick()
    give_player(recorder, "finished", 3 * len(steps))
    capfd.readouterr()
    tick_until_finished(recorder)
    assert "the first of 3 passes; the rest is in pass_002 to pass_003" in capfd.readouterr().err

    first = tmp_path / "run"
    for directory in (first, first / "pass_002", first / "pass_003"):
        results = read_results(directory)
        assert results.summary["complete"] is True, results.summary["incomplete_reason"]
        assert len(results.trajectory) == len(steps)
        assert len(results.dead_reckoning) == len(steps)
        assert len(results.landmarks.ids) == len(landmarks)
        assert (directory / "results.mcap").is_file()


def test_the_map_of_a_pass_may_come_after_the_next_one_has_begun(
    recorder, drive, answers, tmp_path
):
    steps, landmarks = answers
    give_drive(recorder, drive, answers)
    for prediction in drive.predictions:
        give(recorder.on_prediction, PREDICTION, prediction)
    give_step(recorder, steps[0])
    give_map(recorder, steps[-1].stamp, landmarks)
    recorder.on_tick()
    assert summary(tmp_path / "run")["complete"] is True
    assert summary(tmp_path / "run" / "pass_002")["complete"] is False


def test_steps_that_come_again_begin_no_pass(recorder, drive, answers, tmp_path):
    steps, landmarks = answers
    give_drive(recorder, drive, answers)
    for k in (-2, -1):
        give_step(recorder, steps[k], number=len(steps) + 1 + k)
    give_map(recorder, steps[-1].stamp, landmarks)
    recorder.flush()
    assert recorder.monitor.refused.counts["duplicate"] == 2
    assert len((tmp_path / "run" / "trajectory.tum").read_bytes().splitlines()) == len(steps)
    assert not (tmp_path / "run" / "pass_002").exists()


@pytest.mark.parametrize("ahead", [-2, 0, 3, 99])
def test_a_reset_begins_a_new_directory(recorder, drive, answers, tmp_path, ahead):
    """Predictions may have come before the steps of their stamps, or may come after them."""
    steps, _ = answers
    given = 0
    for k, step in enumerate([*steps, None, None]):
        for prediction in drive.predictions[given : max(0, k + 1 + ahead)]:
            give(recorder.on_prediction, PREDICTION, prediction)
            given += 1
        if step is not None:
            give_step(recorder, step, first_of_pass=k in (0, 5))
    recorder.destroy_node()
    first, second = tmp_path / "run", tmp_path / "run" / "pass_002"
    for name in ("trajectory.tum", "dead_reckoning.tum"):
        assert read_tum(first / name).stamps.tolist() == drive.stamps[:5]
        assert read_tum(second / name).stamps.tolist() == drive.stamps[5:]
    assert summary(tmp_path / "run")["incomplete_reason"] == "the estimate was reset"


def test_what_the_nodes_report_goes_into_the_summary(recorder, drive, answers, tmp_path):
    give_drive(recorder, drive, answers)
    statuses = [
        conversions.status(
            "/slam_node",
            {"peak memory [MB]": 81.5, "resets": 2, "refused features_late": 4}
            | {"first features_late [s]": "3.500000000"}
            | verdict_values(Judgement(drive.stamps[-1], Word.DOUBTFUL, ("one", "two"))),
        ),
        conversions.status("/imu_prediction_node", {"refused twist_non_finite": 1}),
    ]
    message = conversions.status_array(conversions.stamp_to_message(0), statuses)
    give(recorder.on_diagnostics, DIAGNOSTICS, message)
    recorder.recording.flush()
    told = summary(tmp_path / "run")
    assert told["peak_rss_mb"] == 81.5
    assert told["resets"] == 2
    assert told["refused"] == {"features_late": 4, "twist_non_finite": 1}
    assert told["refused_first"] == {"features_late": "3.500000000"}
    assert (told["verdict"], told["verdict_reasons"]) == ("doubtful", ["one", "two"])


@pytest.mark.parametrize("values", [{}, {"peak memory [MB]": "much", "resets": 2}])
def test_a_status_of_somebody_else_under_a_nodes_name_is_refused(recorder, values):
    message = conversions.status_array(
        conversions.stamp_to_message(0), [conversions.status("/slam_node", values)]
    )
    recorder.monitor.take(DIAGNOSTICS, serialize_message(message))
    assert recorder.monitor.refused.counts == {"bad_fields": 1}


def test_an_estimator_without_a_bias_leaves_none_in_the_summary(
    recorder, drive, answers, tmp_path
):
    for step in answers[0]:
        give_step(recorder, dataclasses.replace(step, estimates=()))
    recorder.recording.flush()
    told = summary(tmp_path / "run")
    assert told["gyro_bias"] is None
    assert not [name for name in told["estimates"] if "velocity" not in name]


def test_a_map_that_is_on_its_way_is_waited_for(
    recorder, drive, answers, tmp_path, no_patience, monkeypatch
):
    """The way back over a long drive takes longer than any other answer."""
    steps, landmarks = answers
    asked = []
    monkeypatch.setattr(recorder._map._client, "service_is_ready", lambda: True)
    monkeypatch.setattr(recorder._map._client, "call_async", lambda _: answer_later(asked))
    give_drive(recorder, drive, answers)
    give_player(recorder, "finished", len(steps))
    begin = time.monotonic()
    while time.monotonic() - begin < 4 * recorder_node.ANSWER_SECONDS:
        recorder.on_tick()
        assert not recorder.recording.finished
    (answer,) = asked
    give_map(recorder, steps[-1].stamp, landmarks)
    recorder.on_tick()
    assert not recorder.recording.finished
    message = map_answer(len(landmarks), steps[-1].stamp)
    answer.set_result(Trigger.Response(success=True, message=message))
    tick_until_finished(recorder)
    assert summary(tmp_path / "run")["complete"] is True


def test_messages_that_make_no_sense_are_counted(recorder, drive, tmp_path):
    message = conversions.status_array(
        conversions.stamp_to_message(0), [conversions.status("player", {"stat": "x"})]
    )
    recorder.monitor.take(PLAYER, serialize_message(message))
    assert recorder.monitor.refused.counts == {"bad_fields": 1}


def test_results_that_exist_are_refused_unless_forced(make_node, drive, answers, tmp_path):
    first = make_node(RecorderNode, directory=str(tmp_path / "run"))
    give_drive(first, drive, answers)
    first.destroy_node()
    with pytest.raises(VislamError, match="not empty"):
        make_node(RecorderNode, directory=str(tmp_path / "run"))
    second = make_node(RecorderNode, directory=str(tmp_path / "run"), force=True)
    assert second.recording.last_stamp is None
    assert not (tmp_path / "run" / "trajectory.tum").exists()


def test_a_recorder_without_a_directory_does_not_start(make_node):
    with pytest.raises(VislamError, match="directory"):
        make_node(RecorderNode)


def test_the_mcap_file_may_be_left_out(make_node, drive, answers, tmp_path):
    recorder = make_node(RecorderNode, directory=str(tmp_path / "run"), record_mcap=False)
    give_drive(recorder, drive, answers)
    recorder.destroy_node()
    assert not (tmp_path / "run" / "results.mcap").exists()
    assert len(read_tum(tmp_path / "run" / "trajectory.tum")) == len(drive.stamps)
