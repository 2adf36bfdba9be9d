# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.simulation.simulate import SimulationSettings
from vislam_ros.data.sweeps.plan import SweepPlan
from vislam_ros.errors import SettingsError


def plan(simulation=None, seeds=(0,), **grid):
    named = {name.replace("__", "."): values for name, values in grid.items()}
    return SweepPlan({}, PredictionSettings(), simulation, named, seeds)


def test_runs_follow_the_grid_with_its_last_setting_fastest_and_then_the_seeds():
    runs = plan(
        seeds=(0, 1), slam_node__feature_fraction=(0.3, 0.5), slam_node__chi2_gate=(9.0, 25.0)
    ).runs
    settings = [(run.slam.feature_fraction, run.slam.chi2_gate, run.slam.seed) for run in runs]
    assert settings == [
        (fraction, gate, seed)
        for fraction in (0.3, 0.5)
        for gate in (9.0, 25.0)
        for seed in (0, 1)
    ]
    assert [run.seed for run in runs] == [0, 1] * 4
    assert runs[0].point == {"slam_node.feature_fraction": 0.3, "slam_node.chi2_gate": 9.0}


def test_the_key_depends_on_the_settings_and_not_on_how_they_came_about():
    by_default = plan(slam_node__chi2_gate=(16.27,)).runs
    swept = plan(slam_node__chi2_gate=(9, 16.27)).runs
    assert [run.key for run in by_default] == [run.key for run in plan().runs]
    assert by_default[0].key == swept[1].key != swept[0].key
    assert by_default[0].point == {}


def test_one_run_stands_for_all_seeds_where_all_tracks_are_used():
    runs = plan(seeds=(0, 1, 2), slam_node__feature_fraction=(0.5, 1.0)).runs
    assert [(run.slam.feature_fraction, run.seed) for run in runs] == [
        (0.5, 0),
        (0.5, 1),
        (0.5, 2),
        (1.0, 0),
    ]


def test_estimators_are_swept_beside_each_other_and_what_one_does_not_use_is_told():
    swept = plan(
        slam_node__estimator=("joint", "robocentric", "dead_reckoning"),
        slam_node__min_disparity=(2.0, 3.0),
        slam_node__gyro_bias_std=(0.5,),
    )
    assert [run.slam.estimator for run in swept.runs] == [
        estimator for estimator in ("joint", "robocentric", "dead_reckoning") for _ in range(2)
    ]
    assert [run.slam.min_disparity for run in swept.runs[:2]] == [2.0, 3.0]
    # Equal settings at two points: each point has a run all the same.
    assert swept.runs[2].slam == swept.runs[3].slam
    assert len({run.key for run in swept.runs}) == 6
    assert swept.unused_notes() == [
        "gyro_bias_std: set, but not used by estimator joint",
        "min_disparity: set, but not used by estimator robocentric",
        "gyro_bias_std, min_disparity: set, but not used by estimator dead_reckoning",
    ]
    assert plan(slam_node__gyro_bias_std=(0.5,)).unused_notes() == []


def test_in_a_simulated_sweep_the_seed_is_the_simulations():
    runs = plan(SimulationSettings(steps=20), (3, 4), simulate__frozen_share=(0.0, 0.1)).runs
    assert [(run.simulation.frozen_share, run.simulation.seed) for run in runs] == [
        (0.0, 3),
        (0.0, 4),
        (0.1, 3),
        (0.1, 4),
    ]
    assert {run.simulation.steps for run in runs} == {20}
    assert {run.slam.seed for run in runs} == {0}


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({"slam_node__no_such": (1,)}, "slam_node.no_such: no such parameter"),
        ({"slam_node__chi2_gate": (9.0, -1.0)}, "slam_node.chi2_gate: -1.0 is out of range"),
        ({"slam_node__chi2_gate": ("high",)}, "slam_node.chi2_gate: 'high' is not a finite"),
        ({"slam_node__chi2_gate": ()}, "slam_node.chi2_gate: has no value"),
        ({"slam_node__seed": (1, 2)}, "slam_node.seed: is set by the seeds"),
        ({"chi2_gate": (9.0,)}, "chi2_gate: cannot be swept: write slam_node.NAME"),
        ({"simulate__steps": (9,)}, "simulate.steps: the drive is recorded"),
    ],
)
def test_a_wrong_setting_is_refused_before_anything_runs(grid, message):
    with pytest.raises(SettingsError, match=message):
        plan(**grid)
