# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tuning while it runs: set by the parameter services, taken at the next step, told and kept."""

import csv
import json
import logging

import pytest
import yaml
from live.recorder_messages import give
from rclpy.parameter import Parameter

from vislam_ros.core.settings import is_live
from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags.layout import ODOMETRY, STEPS
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.nodes import conversions
from vislam_ros.nodes.recorder.parameter_changes import (
    ParameterChanges,
    change_values,
    changes_from_values,
)
from vislam_ros.nodes.settings import SlamOutputSettings
from vislam_ros.nodes.slam_node import SlamNode
from vislam_ros.nodes.slam_report import row_from_values

CHANGE_AT = 6


@pytest.fixture
def node(make_node):
    return make_node(SlamNode)


def set_on(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


def run(drive, node, capture, changes=()):
    """Give a node the drive, and other parameters before a frame; return what it published."""
    published = capture(node)
    drive.calibrate(node)
    for k, (prediction, features) in enumerate(
        zip(drive.predictions, drive.features, strict=True)
    ):
        if k == CHANGE_AT:
            for name, value in changes:
                assert set_on(node, name, value).successful
        node.on_prediction(prediction)
        node.on_features(features)
    return published


def told(message):
    values = conversions.status_values(message, "slam_step")
    return row_from_values(values)[0], changes_from_values(values)


def record(recorder, published):
    for odometry, step in zip(
        published[ODOMETRY.recorded], published[STEPS.recorded], strict=True
    ):
        give(recorder.on_odometry, ODOMETRY, odometry)
        give(recorder.on_step, STEPS, step)


def test_a_gate_that_is_set_holds_from_the_next_step_on_and_is_told_with_it(
    node, make_node, capture, drive
):
    plain = run(drive, make_node(SlamNode), capture)[STEPS.recorded]
    changed = run(drive, node, capture, [("chi2_gate", 0.3)])[STEPS.recorded]
    for k, (before, after) in enumerate(zip(plain, changed, strict=True)):
        (row, nothing), (row_after, changes) = told(before), told(after)
        assert not nothing
        assert changes == ({"chi2_gate": (16.27, 0.3)} if k == CHANGE_AT else {})
        if k < CHANGE_AT:
            assert {**row, "ms": 0} == {**row_after, "ms": 0}
        elif k == CHANGE_AT:
            assert row_after["rejected"] > row["rejected"]


def test_lists_and_outputs_can_be_set_and_what_was_set_back_is_no_change(node, capture, drive):
    changes = [
        ("pixel_variance", [4.0, 4.0, 4.0, 4.0]),
        ("path_length", 5),
        ("pixel_gate", 3.0),
        ("pixel_gate", 0.0),
    ]
    steps = run(drive, node, capture, changes)[STEPS.recorded]
    assert told(steps[CHANGE_AT])[1] == {
        "path_length": (1000, 5),
        "pixel_variance": ([1.0] * 4, [4.0] * 4),
    }
    assert node.core.settings.pixel_variance == (4.0, 4.0, 4.0, 4.0)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("chi2_gate", -1.0, "chi2_gate"),
        ("pixel_variance", [1.0], "pixel_variance: [1.0] is not a list of 4 numbers"),
        ("pixel_variance", [1.0, 1.0, 1.0, 0.0], "is out of range"),
        ("estimator", "joint", "read-only"),
        ("gyro_bias_std", 0.1, "read-only"),
        ("time_jump", 0.1, "read-only"),
    ],
)
def test_what_cannot_be_is_refused_with_a_reason_and_changes_nothing(node, name, value, reason):
    before = node.core.settings
    result = set_on(node, name, value)
    assert not result.successful
    assert reason in result.reason
    assert node.core.settings == before


def test_a_parameter_that_holds_from_the_start_says_so(node):
    for name in ("estimator", "gyro_bias_std", "map_frame"):
        descriptor = node.describe_parameter(name)
        assert descriptor.read_only
        assert "from the start" in descriptor.additional_constraints
    for field in SlamOutputSettings.__dataclass_fields__.values():
        assert is_live(field)
        assert not node.describe_parameter(field.name).read_only


def test_the_recorder_keeps_each_change_with_the_stamp_of_its_step(
    recorder, node, capture, drive, tmp_path
):
    published = run(drive, node, capture, [("chi2_gate", 0.3)])
    record(recorder, published)
    # The node was asked after the change: what it said then is not what the run began with.
    recorder._on_parameters("slam_node", {"chi2_gate": 0.3, "estimator": "robocentric"})
    recorder.flush()
    with (tmp_path / "run" / "parameter_changes.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["stamp"] == stamp_text(drive.stamps[CHANGE_AT])
    assert (row["node"], row["parameter"]) == ("slam_node", "chi2_gate")
    assert (json.loads(row["before"]), json.loads(row["value"])) == (16.27, 0.3)
    parameters = yaml.safe_load((tmp_path / "run" / "params.yaml").read_text())
    assert parameters["slam_node"]["ros__parameters"]["chi2_gate"] == 16.27
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["parameter_changes"] == 1


def test_the_next_pass_begins_with_what_was_changed_in_the_one_before(
    recorder, node, capture, drive, tmp_path
):
    recorder._on_parameters("slam_node", {"chi2_gate": 16.27})
    record(recorder, run(drive, node, capture, [("chi2_gate", 0.3)]))
    node.reset()
    record(recorder, run(drive, node, capture))
    first, second = (tmp_path / "run" / folder / "params.yaml" for folder in ("", "pass_002"))
    for path, gate in ((first, 16.27), (second, 0.3)):
        parameters = yaml.safe_load(path.read_text())
        assert parameters["slam_node"]["ros__parameters"]["chi2_gate"] == gate


@pytest.mark.parametrize("text", ["[1]", '{"chi2_gate": 3}', '{"chi2_gate": [1]}', "{", "7"])
def test_changes_that_are_none_are_refused(text):
    with pytest.raises(RefusedMessage):
        changes_from_values({"changed": text})


def test_no_change_is_told_in_no_words():
    changes = ParameterChanges(logging.getLogger("test"))
    changes.note(SlamOutputSettings(), SlamOutputSettings())
    assert change_values(changes.take()) == {}
    assert changes_from_values({}) == {}
