# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A live run that ends early: what it says, what it leaves, and that nothing else is left."""

import os
import resource
import shutil
import signal

import pytest

from vislam_ros.data.results.reader import read_results

STEPS = 60
NODES = [f"vislam_ros.nodes.{name}" for name in ("imu_prediction_node", "slam_node")]
SLAM, RECORDER = NODES[1], "vislam_ros.nodes.recorder_node"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_the_middle_keeps_the_results_and_leaves_no_process(start, bag, number):
    run = start(bag)
    run.wait_for_steps()
    run.process.send_signal(number)
    code, _, errors = run.end()
    assert code == 130
    assert errors[-1].startswith("interrupted")
    assert not any("Traceback" in line for line in errors)
    assert not run.pids()
    summary = run.summary()
    assert summary["complete"] is False
    assert summary["incomplete_reason"] == "the run was interrupted"
    results = read_results(run.out)
    assert 5 < len(results.trajectory) < STEPS
    assert summary["steps"] == len(results.trajectory)
    assert summary["landmarks"] == len(results.landmarks) > 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_while_the_nodes_start_ends_all(start, bag, number):
    run = start(bag)
    run.wait_until(lambda: SLAM in run.pids(), "the start of slam_node")
    run.process.send_signal(number)
    code, _, errors = run.end()
    assert code == 130
    assert errors[-1].startswith("interrupted")
    assert not run.pids()


def test_a_node_that_is_killed_while_the_nodes_start_is_named(start, bag):
    run = start(bag)
    run.wait_until(lambda: SLAM in run.pids(), "the start of slam_node")
    os.kill(run.pids()[SLAM], signal.SIGKILL)
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith("error: slam_node ended early with signal 9 (SIGKILL)")
    assert not run.pids()


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
    os.kill(run.pids()[SLAM], signal.SIGKILL)
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith("error: slam_node ended early with signal 9 (SIGKILL)")
    assert not run.pids()
    assert run.summary()["incomplete_reason"].startswith("slam_node ended early")
    assert len(read_results(run.out).trajectory) == run.summary()["steps"] > 5


def test_a_node_that_stands_still_is_named_and_one_that_goes_on_again_is_not(start, bag):
    run = start(bag)
    run.wait_for_steps()
    for number, has_stopped in ((signal.SIGSTOP, True), (signal.SIGCONT, False)):
        os.kill(run.pids()[RECORDER], number)
        run.wait_until(lambda s=has_stopped: run.is_stopped(RECORDER) is s, number.name)
    os.kill(run.pids()[SLAM], signal.SIGSTOP)
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith("error: slam_node was stopped by a signal and did not go on")
    assert not run.pids()


def test_ctrl_z_stops_the_nodes_too_and_fg_lets_all_go_on_to_the_end(start, bag):
    run = start(bag, "--rate", "2", preexec_fn=os.setpgrp)  # as a shell starts a job
    run.wait_for_steps()
    os.killpg(run.process.pid, signal.SIGTSTP)
    run.wait_until(lambda: all(map(run.is_stopped, NODES)), "the stop")
    os.killpg(run.process.pid, signal.SIGCONT)
    assert run.end()[0] == 0
    assert (run.summary()["complete"], run.summary()["steps"]) == (True, STEPS)


def test_a_deleted_output_is_named(start, bag):
    run = start(bag)
    run.wait_for_steps()
    # The recorder goes on writing here: moved away first, no new file holds the deletion up.
    shutil.rmtree(run.out.rename(run.out.with_name("deleted")))
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith("error: recorder_node ended early")
    assert f"{run.out}/" in errors[-1]
    assert "No such file or directory" in errors[-1]
    assert not run.out.exists()


def test_a_file_that_cannot_grow_is_named_and_its_rows_stay_whole(start, bag):
    limit = 4000  # bytes of any one file
    run = start(
        bag,
        "--rate=5",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        environment={"NUMBA_CACHE_DIR": ""},
        measured=False,  # what measures coverage writes files of its own
    )
    code, _, errors = run.end()
    assert code == 1
    assert errors[-1].startswith(f"error: recorder_node ended early with exit code 1: {run.out}/")
    assert "File too large" in errors[-1]
    assert not run.pids()
    for line in (run.out / "dead_reckoning.tum").read_text().splitlines():
        assert len(line.split()) == 8
