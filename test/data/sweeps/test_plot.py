# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.sweeps.plan import SweepPlan
from vislam_ros.data.sweeps.plot import draw_sweep, picture_bytes
from vislam_ros.data.sweeps.table import gather

GATE = {"slam_node.chi2_gate": (9.0, 16.0, 25.0)}
FRACTION = {"slam_node.feature_fraction": (0.3, 0.5)}
ESTIMATOR = {"slam_node.estimator": ("joint", "block_diagonal")}


def drawn(grid, seeds=(0,), truth=True):
    """A sweep in which everything is known but its second run, which failed."""
    plan = SweepPlan({}, PredictionSettings(), None, grid, seeds)
    figures = {"ate_m": 1.5, "nees_per_dof": 2.0} if truth else {}
    rows = {
        run.key: {"key": run.key, "seed": run.seed, "nis_per_dof": 1.0, "error": None, **figures}
        for run in plan.runs
    }
    if len(rows) > 1:
        rows[plan.runs[1].key] = {"key": plan.runs[1].key, "error": "failed"}
    return draw_sweep(plan, gather(plan.runs, rows))


@pytest.mark.parametrize(
    ("grid", "label"),
    [
        ({}, "seed"),
        (GATE, "slam_node.chi2_gate"),
        (ESTIMATOR, "slam_node.estimator"),
        ({**FRACTION, **GATE}, "slam_node.chi2_gate"),
        ({**ESTIMATOR, **FRACTION, **GATE}, "slam_node.chi2_gate"),
    ],
)
def test_whatever_is_swept_stands_along_x(grid, label):
    figure = drawn(grid)
    fields = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    assert [axes.get_title() for axes in fields] == ["ATE, aligned [m]", "NEES / 6"]
    assert all(axes.get_xlabel() == label for axes in fields)
    assert picture_bytes(figure).startswith(b"\x89PNG")


def test_a_field_is_labelled_with_its_value_and_a_failed_one_with_a_dash():
    figure = drawn({**FRACTION, **GATE})
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["1.5", "-", "1.5", "1.5", "1.5", "1.5"]


def test_a_colour_bar_says_which_end_is_better():
    errors, ratios = (axes for axes in drawn({**FRACTION, **GATE}).axes if not axes.get_title())
    assert errors.get_ylabel().split()[0] == "better"
    assert errors.get_ylim()[0] < errors.get_ylim()[1]  # and better, at its foot, is less
    assert "1 is best" in ratios.get_ylabel()
    low, high = ratios.get_ylim()
    assert low * high == pytest.approx(1.0)  # half is as far from it as double
    assert high == pytest.approx(2.0)
    assert [label.get_text() for label in ratios.get_yticklabels()] == ["0.5", "1", "2"]


def test_without_a_truth_consistency_is_drawn():
    figure = drawn(GATE, truth=False)
    assert figure.axes[0].get_title() == "NIS / dof"
    assert "not known" in figure.axes[1].texts[0].get_text()
