# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole live graph as processes: what it leaves when it ends well."""

import csv
import shutil
import subprocess
import sys

from live.running import WAIT

from vislam_ros.cli.main import main
from vislam_ros.data.results.reader import read_results

STEPS = 60


def timeless_steps(directory):
    """Cells of steps.csv, as written, without the times that the steps took."""
    with (directory / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert all(float(row.pop("ms")) > 0 for row in rows)
    return rows


def test_two_runs_side_by_side_give_the_offline_trajectory(start, dataset, bag, tmp_path):
    runs = [
        start(dataset, "--rate", "0", name="one", pictures=True),
        start(bag, "--rate", "5", name="two"),
    ]
    assert main(["solve", str(dataset), "--out", str(tmp_path / "solved")]) == 0
    for run in runs:
        code, output, _ = run.end()
        assert code == 0
        assert "complete" in output
        run.assert_nothing_is_left()
        for name in ("trajectory.tum", "dead_reckoning.tum"):
            solved = (tmp_path / "solved" / name).read_bytes()
            assert (run.out / name).read_bytes() == solved, name
        assert timeless_steps(run.out) == timeless_steps(tmp_path / "solved")
        offline = read_results(tmp_path / "solved").summary
        for name in ("gyro_bias", "estimates", "rejected_fraction", "nis_per_dof", "tracks"):
            assert run.summary()[name] == offline[name], name
        assert main(["verify", str(run.out)]) == 0
        summary = run.summary()
        assert (summary["steps"], summary["refused"]) == (STEPS, {})
        assert summary["total_s"] > summary["wall_s"]
        assert (run.out / "trajectory.png").is_file() == (run.out.name == "one")
        assert (run.out / "log" / "slam_node.log").is_file()


def test_flags_reach_the_nodes_and_it_says_how_to_join_them(start, dataset):
    flags = ("--estimator", "dead_reckoning", "--fraction", "0.5", "--seed", "7")
    run = start(dataset, "--rate", "0", *flags, environment={"ROS_DOMAIN_ID": "77"})
    code, _, errors = run.end()
    assert code == 0
    example = " ros2 topic list" if shutil.which("ros2") else ""
    settings = "ROS_DOMAIN_ID=77 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
    assert f"to join this run: {settings}{example}" in errors
    used = read_results(run.out).parameters["slam_node"]
    assert used["estimator"] == "dead_reckoning"
    assert (used["feature_fraction"], used["seed"]) == (0.5, 7)


def test_it_names_the_result_directory_as_it_was_given(dataset, tmp_path):
    run = subprocess.run(
        [
            *(sys.executable, "-m", "vislam_ros.cli.main", "run", dataset, "--out", "out"),
            *("--rate", "0", "--no-pictures"),
        ],
        cwd=tmp_path,
        timeout=WAIT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"{dataset.stem} in out" in run.stdout
    assert "wrote out: " in run.stderr
    assert "next: vislam evaluate out --reference " in run.stderr
