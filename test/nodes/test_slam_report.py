# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node says of its steps, and what is read of that."""

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
from vislam_ros.data.bags.layout import DEFAULT_FRAMES
from vislam_ros.nodes import conversions
from vislam_ros.nodes.slam_report import (
    PREVIOUS,
    SlamReport,
    row_from_values,
    step_values,
    verdict_from_values,
    verdict_values,
)


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
