# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import csv
import dataclasses
import json
import warnings

import pytest

from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.log import SweepLog, identity_of
from vislam_ros.data.sweeps.plan import SweepPlan
from vislam_ros.data.sweeps.run import SweepInputs, execute
from vislam_ros.data.sweeps.sweeping import missing_runs, sweep
from vislam_ros.errors import VislamError

SIMULATION = SimulationSettings(steps=25, landmarks=60)
JOINT = {"estimator": "joint"}


@pytest.fixture(scope="module")
def inputs():
    drive = simulate(SIMULATION).drive
    return SweepInputs(drive, drive.ground_truth)


def plan(simulation=None, seeds=(0,), **grid):
    named = {f"slam_node.{name}": values for name, values in grid.items()}
    return SweepPlan(JOINT, PredictionSettings(), simulation, named, seeds)


def run(directory, plan, inputs, **options):
    rows = []
    with SweepLog(directory, identity_of(inputs)) as log:
        points = sweep(plan, inputs, log, jobs=1, on_row=rows.append, **options)
    return points, rows


def without_times(row):
    return {name: value for name, value in row.items() if name not in ("wall_s", "step_ms_p50")}


def test_a_row_is_what_solve_and_evaluate_say(inputs):
    settings = JointSettings(chi2_gate=9.0)
    row = execute(inputs, plan(chi2_gate=(9.0,)).runs[0])
    solution = solve(inputs.drive, settings, PredictionSettings())
    assert row["error"] is None
    assert row["ate_m"] == compare(inputs.reference, solution.trajectory)["ate_m"]["rmse"]
    assert row["landmarks"] == len(solution.landmarks)
    assert row["steps"] == SIMULATION.steps
    assert row["nees_per_dof"] > 0
    json.dumps(row, allow_nan=False)


def test_a_run_without_a_step_has_the_reason_as_its_error(inputs):
    still = dataclasses.replace(
        inputs.drive, twist_stamps=inputs.drive.twist_stamps[:1], twists=inputs.drive.twists[:1]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        row = execute(SweepInputs(still), plan(chi2_gate=(9.0,)).runs[0])
    assert row["error"].startswith(f"not one step: {SIMULATION.steps} features_no_prediction (no ")


def test_only_what_is_missing_runs_and_the_table_keeps_the_order(tmp_path, inputs):
    _, first = run(tmp_path, plan(chi2_gate=(25.0, 9.0)), inputs)
    assert [row["slam_node.chi2_gate"] for row in first] == [25.0, 9.0]
    _, again = run(tmp_path, plan(chi2_gate=(25.0, 9.0)), inputs)
    assert not again
    points, more = run(tmp_path, plan(chi2_gate=(9.0, 16.0, 25.0)), inputs)
    assert [row["slam_node.chi2_gate"] for row in more] == [16.0]
    assert [point.point["slam_node.chi2_gate"] for point in points] == [9.0, 16.0, 25.0]

    table = list(csv.DictReader((tmp_path / "table.csv").open()))
    assert [line["slam_node.chi2_gate"] for line in table] == ["9", "16", "25"]
    assert float(table[0]["ate_m_mean"]) == first[1]["ate_m"]
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_that_fails_is_a_row_and_the_others_go_on(tmp_path, inputs):
    failing = plan(estimator=("localization", "joint"))
    points, rows = run(tmp_path, failing, inputs)
    assert [row["error"] is None for row in rows] == [False, True]
    assert "needs a map" in points[0].errors[0]
    assert points[1].mean("ate_m") is not None
    _, again = run(tmp_path, failing, inputs)
    assert not again


def test_a_run_whose_process_was_killed_is_repeated(tmp_path, inputs):
    one = plan(chi2_gate=(9.0,))
    with SweepLog(tmp_path, identity_of(inputs)) as log:
        log.append({"key": one.runs[0].key, "error": "its process died", "unfinished": True})
        assert missing_runs(one, log) == one.runs
    points, rows = run(tmp_path, one, inputs)
    assert len(rows) == 1
    assert not points[0].errors


def test_a_monte_carlo_simulates_a_drive_for_each_seed(tmp_path):
    simulated = plan(SIMULATION, (0, 1, 2), chi2_gate=(9.0,))
    (point,), _ = run(tmp_path, simulated, SweepInputs())
    assert [row["seed"] for row in point.rows] == [0, 1, 2]
    assert len(set(point.values("dead_reckoning_ate_m"))) == 3


def test_without_a_truth_there_is_no_error_but_consistency(tmp_path, inputs):
    points, _ = run(tmp_path, plan(), SweepInputs(inputs.drive))
    assert points[0].mean("ate_m") is None
    assert points[0].mean("nis_per_dof") > 0


def test_dask_and_processes_give_equal_rows(tmp_path, inputs):
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    two = plan(chi2_gate=(9.0, 25.0))
    _, here = run(tmp_path / "here", two, inputs)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        _, there = run(tmp_path / "there", two, inputs, dask=cluster.scheduler_address)
    by_key = {row["key"]: without_times(row) for row in there}
    assert [by_key[row["key"]] for row in here] == [without_times(row) for row in here]


def test_a_smoothed_sweep_has_both_errors_and_is_another_sweep(tmp_path, inputs):
    smoothing = dataclasses.replace(inputs, smooth=True)
    (point,), (row,) = run(tmp_path, plan(), smoothing)
    filtered = execute(inputs, plan().runs[0])
    assert row["ate_m"] == filtered["ate_m"]
    assert "smoothed_ate_m" not in filtered
    assert row["smoothed_ate_m"] != row["ate_m"]
    assert row["smoothed_nees_per_dof"] > 0
    assert "smoothed_ate_m_mean" in (tmp_path / "table.csv").read_text()
    assert point.mean("smoothed_ate_m") == row["smoothed_ate_m"]
    with pytest.raises(VislamError, match="--smooth"):
        run(tmp_path, plan(), inputs)
