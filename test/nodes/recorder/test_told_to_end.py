# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A recorder that is told to end, without a player: by its callbacks, as the whole of them."""

import pytest
from live.recorder_messages import (
    answer_later,
    give,
    give_map,
    give_slam_report,
    give_step,
    summary,
    tick_until_finished,
)
from std_srvs.srv import Trigger

from vislam_ros.data.bags.layout import DIAGNOSTICS, FEATURES
from vislam_ros.data.trajectory import read_tum
from vislam_ros.nodes import conversions, recorder_node
from vislam_ros.nodes.recorder.map_request import map_answer


@pytest.fixture
def slam_node(recorder, monkeypatch):
    """Requests for the map that somebody has taken; the test answers them."""
    asked = []
    monkeypatch.setattr(recorder._map._client, "service_is_ready", lambda: True)
    monkeypatch.setattr(recorder._map._client, "call_async", lambda _: answer_later(asked))
    return asked


def test_a_recording_that_is_told_to_end_ends_with_the_step_of_its_map(
    recorder, drive, answers, tmp_path, no_patience, slam_node
):
    """The graph goes on: what comes after that step is not recorded."""
    steps, landmarks = answers
    for k, step in enumerate(steps[:5]):
        give_step(recorder, step, number=k + 1)
    assert not recorder.is_told_to_end
    recorder.finish()
    assert recorder.is_told_to_end
    for k in (5, 6):
        give_step(recorder, steps[k], number=k + 1)
    recorder.on_tick()
    (answer,) = slam_node
    message = map_answer(len(landmarks), steps[7].stamp)
    answer.set_result(Trigger.Response(success=True, message=message))
    give_map(recorder, steps[7].stamp, landmarks)
    give_slam_report(recorder, steps=8, **{f"received {FEATURES.name}": 8})
    for k in (7, 8, 9):
        assert not recorder.recording.finished
        give_step(recorder, steps[k], number=k + 1)
    give_map(recorder, steps[9].stamp, landmarks)
    tick_until_finished(recorder)
    assert summary(tmp_path / "run")["incomplete_reason"] is None
    assert read_tum(tmp_path / "run" / "trajectory.tum").stamps.tolist() == drive.stamps[:8]
    assert len(slam_node) == 1


def test_a_recorder_that_began_after_the_last_step_ends_without_it(
    recorder, answers, tmp_path, slam_node, monkeypatch
):
    monkeypatch.setattr(recorder_node, "ANSWER_SECONDS", 1e9)  # as slam_node is there
    steps, landmarks = answers
    give_slam_report(recorder, steps=7, **{f"received {FEATURES.name}": 7})
    recorder.finish()
    recorder.on_tick()
    (answer,) = slam_node
    message = map_answer(len(landmarks), steps[6].stamp)
    answer.set_result(Trigger.Response(success=True, message=message))
    give_map(recorder, steps[6].stamp, landmarks)
    tick_until_finished(recorder)
    told = summary(tmp_path / "run")
    assert told["incomplete_reason"] == "not one step: slam_node had published its 7 before"


def test_a_recording_of_a_graph_that_is_gone_keeps_what_came_and_misses_the_map(
    recorder, drive, answers, tmp_path
):
    steps, _ = answers
    give_slam_report(recorder, steps=7, **{f"received {FEATURES.name}": 7})
    give_step(recorder, steps[0])
    recorder.finish()
    for k in range(1, 7):
        give_step(recorder, steps[k], number=k + 1)
    tick_until_finished(recorder)
    told = summary(tmp_path / "run")
    assert (told["steps"], told["incomplete_reason"]) == (7, "the landmark map did not arrive")


def test_a_gap_is_named_when_a_recording_is_told_to_end(recorder, answers, tmp_path):
    steps, _ = answers
    give_slam_report(recorder, steps=7, **{f"received {FEATURES.name}": 7})
    for number in (1, 2, 5, 6, 7):
        give_step(recorder, steps[number - 1], number=number)
    recorder.finish()
    tick_until_finished(recorder)
    assert summary(tmp_path / "run")["incomplete_reason"] == "2 of 7 steps did not arrive"


def test_a_recorder_that_is_hurried_ends_as_it_stands(recorder, answers, tmp_path, slam_node):
    steps, _ = answers
    give_slam_report(recorder, steps=2, **{f"received {FEATURES.name}": 2})
    give_step(recorder, steps[0])
    assert recorder.wind_up(hurried=False) is False
    give_step(recorder, steps[1], number=2)
    recorder.on_tick()
    assert recorder.wind_up(hurried=False) is False
    assert recorder.wind_up(hurried=True) is True
    told = summary(tmp_path / "run")
    assert (told["steps"], told["incomplete_reason"]) == (2, "the landmark map did not arrive")


def test_a_recorder_that_is_the_last_one_takes_what_has_come_and_asks_nobody(
    recorder, answers, tmp_path, slam_node
):
    steps, _ = answers
    give_step(recorder, steps[0])
    assert recorder.wind_up(hurried=True) is False
    give_step(recorder, steps[1], number=2)
    assert recorder.wind_up(hurried=True) is True
    assert summary(tmp_path / "run")["steps"] == 2
    assert not slam_node


def test_reports_of_another_robot_s_nodes_are_not_ours(recorder, answers, tmp_path):
    give_slam_report(recorder, resets=1)
    status = conversions.status("/robot2/slam_node", {"peak memory [MB]": 1.0, "resets": 9})
    message = conversions.status_array(conversions.stamp_to_message(0), [status])
    give(recorder.on_diagnostics, DIAGNOSTICS, message)
    recorder.recording.flush()
    assert summary(tmp_path / "run")["resets"] == 1
