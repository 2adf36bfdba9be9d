# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole live graph as processes: what it leaves when it ends well, badly, or is killed."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from places import REPOSITORY

from vislam_ros.cli.main import main
from vislam_ros.data.results.reader import read_results

WAIT = 60.0
STEPS = 60


class Run:
    """A ``vislam run`` whose children can be told from all other processes by its directory."""

    def __init__(self, data, out, *flags):
        environment = {k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"}
        self.out = out
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vislam_ros.cli.main", "run", data, "--out", out, *flags],
            cwd=REPOSITORY,
            env={**environment, "VISLAM_TEST_RUN": str(out)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def pids(self):
        """The processes of this run that are alive, by what they run."""
        mark = f"VISLAM_TEST_RUN={self.out}\0".encode()
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it may end while we look
                if mark in (folder / "environ").read_bytes():
                    words = (folder / "cmdline").read_bytes().decode().split("\0")
                    modules = [word for word in words if word.startswith("vislam_ros.")]
                    found[modules[-1] if modules else "?"] = int(folder.name)
        return found

    def summary(self):
        try:
            return json.loads((self.out / "summary.json").read_text())
        except FileNotFoundError:
            return {}

    def wait_until(self, condition, what):
        deadline = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not happen"
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.02)

    def wait_for_steps(self):
        self.wait_until(lambda: self.summary().get("steps", 0) > 5, "the first steps")

    def end(self):
        output, errors = self.process.communicate(timeout=WAIT)
        return self.process.returncode, output, errors.splitlines()

    def assert_nothing_is_left(self):
        deadline = time.monotonic() + WAIT
        while self.pids():
            assert time.monotonic() < deadline, f"still alive: {self.pids()}"
            time.sleep(0.02)


@pytest.fixture
def start(tmp_path):
    runs = []

    def start(data, *flags, name="run"):
        run = Run(data, tmp_path / name, *flags)
        runs.append(run)
        return run

    yield start
    for run in runs:
        run.process.kill()
        run.process.communicate(timeout=WAIT)


def timeless_steps(directory):
    """Cells of steps.csv, as written, without the times that the steps took."""
    with (directory / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert all(float(row.pop("ms")) > 0 for row in rows)
    return rows


def test_two_runs_side_by_side_give_the_offline_trajectory(start, dataset, bag, tmp_path):
    runs = [
        start(dataset, "--rate", "0", name="one"),
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
        assert (run.out / "trajectory.png").is_file()
        assert (run.out / "log" / "slam_node.log").is_file()


def test_flags_reach_the_nodes(start, dataset):
    run = start(
        dataset, "--rate", "0", "--estimator", "dead_reckoning", "--fraction", "0.5", "--seed", "7"
    )
    assert run.end()[0] == 0
    used = read_results(run.out).parameters["slam_node"]
    assert used["estimator"] == "dead_reckoning"
    assert (used["feature_fraction"], used["seed"]) == (0.5, 7)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_the_middle_keeps_the_results_and_leaves_no_process(start, bag, number):
    run = start(bag)
    run.wait_for_steps()
    run.process.send_signal(number)
    code, _, errors = run.end()
    assert code == 130
    assert errors[-1].startswith("interrupted")
    assert not any("Traceback" in line for line in errors)
    run.assert_nothing_is_left()
    summary = run.summary()
    assert summary["complete"] is False
    assert summary["incomplete_reason"] == "the player was interrupted"
    results = read_results(run.out)
    assert 5 < len(results.trajectory) < STEPS
    assert len(results.landmarks) > 0


def test_ctrl_c_while_the_nodes_start_ends_all(start, bag):
    run = start(bag)
    run.wait_until(lambda: "vislam_ros.nodes.slam_node" in run.pids(), "the start of slam_node")
    run.process.send_signal(signal.SIGINT)
    code, _, errors = run.end()
    assert code == 130
    assert errors[-1].startswith("interrupted")
    run.assert_nothing_is_left()


def test_a_kill_leaves_the_rows_so_far_and_no_process(start, bag):
    run = start(bag)
    run.wait_for_steps()
    run.process.kill()
    run.assert_nothing_is_left()
    assert len(read_results(run.out).trajectory) > 5
    assert run.summary()["complete"] is False


def test_a_node_that_dies_is_named_and_the_results_are_kept(start, bag):
    run = start(bag)
    run.wait_for_steps()
    os.kill(run.pids()["vislam_ros.nodes.slam_node"], signal.SIGKILL)
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith("error: slam_node ended early with signal 9")
    run.assert_nothing_is_left()
    assert len(read_results(run.out).trajectory) > 5
    assert run.summary()["complete"] is False
