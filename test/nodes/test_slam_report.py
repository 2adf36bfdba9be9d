# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node says of its steps and of its estimate, and what is read of that."""

import copy
import json
import re

import pytest
from places import REPOSITORY
from rclpy.node import Node

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.step import StepTotals
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.core.verdict.reason import Judgement, Word
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, DIAGNOSTICS, LANDMARKS, ODOMETRY
from vislam_ros.nodes import conversions
from vislam_ros.nodes.slam_node import SlamNode
from vislam_ros.nodes.slam_report import (
    PREVIOUS,
    SlamReport,
    row_from_values,
    step_values,
    verdict_from_values,
    verdict_values,
)

WELL, WARN = b"\x00", b"\x01"
PERIOD = 100_000_000


@pytest.fixture
def core(drive):
    core = Slam(RobocentricSettings())
    core.set_camera(drive.camera)
    return core


@pytest.fixture
def steps(core, drive):
    steps = []
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        steps += core.add_prediction(*decoding.pose(prediction))
        steps += core.add_features(*decoding.features(features, DEFAULT_FRAMES))
    return steps


@pytest.fixture
def report(core, make_node):
    class Probe(Node):
        def __init__(self, **options):
            super().__init__("probe", **options)

    return SlamReport(make_node(Probe), core)


def texts(values):
    """Values as a message carries them."""
    return {value.key: value.value for value in conversions.status("slam_step", values).values}


def test_a_row_comes_out_of_a_message_as_it_went_in(steps):
    for step in steps:
        row, latency_ms, number = row_from_values(texts(step_values(step.row(), 1.5, 7)))
        assert list(row.items()) == list(step.row().items())
        assert [type(value) for value in row.values()] == [
            type(value) for value in step.row().values()
        ]
        assert (latency_ms, number) == (1.5, 7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"used": "many"}, "many"),
        ({"gyro_bias_x": "none"}, "none"),
        ({"used": None, "nis": None}, "without nis, used"),
        ({"latency_ms": None}, "latency_ms"),
    ],
)
def test_a_message_that_lacks_a_number_is_refused(steps, change, words):
    told = {**json.loads(texts(step_values(steps[0].row(), 1.5, 1))["row"]), **change}
    row = {name: value for name, value in told.items() if value is not None}
    with pytest.raises(RefusedMessage, match=words) as refusal:
        row_from_values({"row": json.dumps(row)})
    assert refusal.value.refusal is Refusal.BAD_FIELDS


@pytest.mark.parametrize("values", [{}, {"row": ""}, {"row": "[1, 2]"}, {"row": "[" * 100_000}])
def test_a_message_without_a_row_is_refused(values):
    with pytest.raises(RefusedMessage, match="slam/steps") as refusal:
        row_from_values(values)
    assert refusal.value.refusal is Refusal.BAD_FIELDS


def test_diagnostics_tell_what_the_steps_since_the_last_report_amount_to(report, steps):
    for part in (steps[:5], steps[5:]):
        totals = StepTotals()
        for step in part:
            report.add(step, step.row())
            totals.add(step.row())
        values = report.values()
        assert totals.nis_dof > 0
        assert values["NIS per degree of freedom"] == totals.nis_per_dof
        assert values["rejected [%]"] == 100 * totals.rejected_fraction
        assert values["step max [ms]"] == max(step.ms for step in part)
    assert values["steps"] == len(steps)
    assert "step max [ms]" not in report.values()


def test_diagnostics_tell_what_the_layout_of_foxglove_plots(report, steps):
    text = (REPOSITORY / "config" / "vislam.foxglove.json").read_text()
    plotted = set(re.findall(r'key==\\"([^"]*)\\"', text))
    for step in steps:
        report.add(step, step.row())
    assert len(plotted) > 2
    assert plotted <= report.values().keys()


def test_diagnostics_tell_what_the_filter_estimates_with_its_deviation_and_unit(report, steps):
    report.add(steps[-1], steps[-1].row())
    values, row = report.values(), steps[-1].row()
    for name, label in (
        ("gyro_bias_y", "gyro bias y [rad/s]"),
        ("gyro_bias_std_z", "gyro bias std z [rad/s]"),
        ("lens_distortion_std", "lens distortion std"),
        ("pixel_noise_std", "pixel noise std [px]"),
        ("velocity_walk_std_x", "velocity walk std x [m/s/sqrt(s)]"),
    ):
        assert values[label] == row[name]


@pytest.mark.parametrize(
    "judgement",
    [
        Judgement(1_317_000_000_000_000_123, Word.GOOD, ()),
        Judgement(5, Word.CONTRADICTION, ("30% of them; so", "NIS is 2.8")),
    ],
)
def test_a_verdict_comes_out_of_a_message_as_it_went_in(judgement):
    values = texts({**verdict_values(judgement), "verdict of others": 3})
    assert verdict_from_values(values) == judgement
    assert verdict_from_values(values, PREVIOUS) is None


@pytest.mark.parametrize("change", [{"verdict": "fair"}, {"verdict at [ns]": "noon"}])
def test_a_verdict_that_is_none_is_refused(change):
    values = {**texts(verdict_values(Judgement(5, Word.GOOD, ()))), **change}
    with pytest.raises(RefusedMessage, match="verdict"):
        verdict_from_values(values)


def test_diagnostics_tell_the_verdict_on_the_steps_and_on_those_before(report, core, steps):
    assert verdict_from_values(texts(report.values())) == core.verdict()
    core.reset()
    values = texts(report.values())
    assert verdict_from_values(values) is None
    assert verdict_from_values(values, PREVIOUS) == core.previous_verdict


def values_of(message):
    return conversions.status_values(message, "/slam_node")


def give_all(node, drive):
    for prediction in drive.predictions:
        node.on_prediction(prediction)
    for features in drive.features:
        node.on_features(features)


def at(message, stamp):
    """Return the same message with another stamp (ns)."""
    result = copy.deepcopy(message)
    result.header.stamp = conversions.stamp_to_message(stamp)
    return result


def test_the_verdict_on_a_pass_goes_out_before_its_map_when_the_next_one_begins(
    make_node, capture, drive
):
    node = make_node(SlamNode)
    order, published = [], capture(node)
    keep = node.monitor.publish

    def noted(publisher, message):
        order.append(publisher.topic_name)
        keep(publisher, message)

    node.monitor.publish = noted
    drive.calibrate(node)
    give_all(node, drive)
    verdict, already = node.core.verdict(), len(order)
    give_all(node, drive)
    beginning = order[already:]
    assert beginning.index(DIAGNOSTICS.recorded) < beginning.index(LANDMARKS.recorded)
    told = [verdict_from_values(values_of(m), PREVIOUS) for m in published[DIAGNOSTICS.recorded]]
    assert told[-1] == verdict
    assert verdict.stamp == drive.stamps[-1]


def test_diagnostics_warn_while_vision_is_missing_and_are_well_when_it_is_back(
    make_node, capture, drive
):
    node = make_node(SlamNode)
    published = capture(node)

    def reported():
        node.monitor.report()
        return published[DIAGNOSTICS.recorded][-1]

    drive.calibrate(node)
    for prediction in drive.predictions:
        node.on_prediction(prediction)
    for features in drive.features[:6]:
        node.on_features(features)
    assert reported().status[0].level == WELL

    late = drive.stamps[5] + 4_000_000_000
    for stamp in range(drive.stamps[-1] + PERIOD, late + PERIOD // 2, PERIOD):
        node.on_prediction(at(drive.predictions[-1], stamp))
    status = reported().status[0]
    assert status.level == WARN
    assert status.message.startswith(
        "running; doubtful: vision was missing for 4.0 s, 0.5 s after"
    )

    for k in range(3):
        node.on_prediction(at(drive.predictions[-1], late + (k + 1) * PERIOD))
        node.on_features(at(drive.features[6 + k], late + k * PERIOD))
    assert len(published[ODOMETRY.recorded]) == 9
    message = reported()
    assert (message.status[0].level, message.status[0].message) == (WELL, "running")
    # That it was missing remains true of the drive.
    assert values_of(message)["verdict"] == "doubtful"
    assert values_of(message)["verdict reason 1"].startswith("vision was missing for 4.")
