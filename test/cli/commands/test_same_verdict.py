# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam solve`` and ``vislam run``, whole, over bags with something wrong: one verdict."""

import json
import os
import subprocess
import sys

import pytest
from places import REPOSITORY, SHARED_CASES
from rewriting import from_half_on_anew, rewritten, unchanged

from vislam_ros.cli.main import main
from vislam_ros.data.bags.layout import FEATURES, TWIST
from vislam_ros.data.results.writer import pass_directories

WAIT = 120.0

SAME = (
    *("steps", "complete", "incomplete_reason", "refused", "refused_first"),
    *("verdict", "verdict_reasons"),
)


@pytest.fixture
def both(tmp_path):
    """Solve and run the same data; gives exit code, last line on stderr and passes of each."""

    def both(data, *flags):
        return [end_of(command, data, tmp_path / command, *flags) for command in ("solve", "run")]

    return both


def end_of(command, data, out, *flags):
    rate = ["--rate", "0", "--no-pictures"] if command == "run" else []
    process = subprocess.run(
        [sys.executable, "-m", "vislam_ros.cli.main", command, data, "--out", out, *rate, *flags],
        cwd=REPOSITORY,
        env={k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"},
        capture_output=True,
        text=True,
        timeout=WAIT,
        check=False,
    )
    elsewhere = ("to join this run: ", "wrote ", "next: ")
    lines = [line for line in process.stderr.splitlines() if not line.startswith(elsewhere)]
    passes = [
        (
            json.loads((folder / "summary.json").read_text()),
            (folder / "trajectory.tum").read_bytes(),
        )
        for folder in pass_directories(out)
    ]
    return process.returncode, lines[-1] if lines else "", passes


def case(name):
    bag = SHARED_CASES / name / "bag"
    if not bag.is_dir():
        pytest.skip(f"needs {name}, which is not in {SHARED_CASES}: set VISLAM_SHARED_DATA")
    return bag


def assert_same_end(solved, ran):
    assert solved[:2] == ran[:2]
    for (one, trajectory), (other, other_trajectory) in zip(solved[2], ran[2], strict=True):
        for name in SAME:
            assert one[name] == other[name], name
        assert trajectory == other_trajectory


def test_a_last_frame_behind_the_last_twist_is_named_and_no_failure(both):
    solved, ran = both(case("10_last_frame_after_last_twist"))
    assert_same_end(solved, ran)
    code, line, ((summary, _),) = solved
    assert (code, summary["steps"], summary["complete"]) == (0, 59, True)
    assert line == (
        "note: not used: 1 features_no_prediction (no predicted motion reaches its stamp, the "
        "first at 1700000005.905000095 s)"
    )


def test_inverted_extrinsics_are_named_and_no_failure(both):
    solved, ran = both(case("07_inverse_extrinsics"))
    assert_same_end(solved, ran)
    code, line, ((summary, _),) = solved
    assert (code, line) == (0, "")
    assert summary["verdict"] == "contradiction"
    assert "T_body_camera inverted would fit" in summary["verdict_reasons"][0]


def test_a_few_bad_messages_are_named_and_no_failure(both):
    solved, ran = both(case("11_one_bad_message"))
    assert_same_end(solved, ran)
    code, line, ((summary, _),) = solved
    assert (code, summary["steps"], summary["complete"]) == (0, 57, True)
    assert line.startswith("note: not used: 3 features_duplicate_ids (an id appears twice, the ")


def test_a_shuffled_log_is_sorted_offline_and_told_of_live(both):
    solved, ran = both(case("12_log_times_shuffled"))
    assert (solved[0], solved[1]) == (0, "")
    (((summary, _),), ((live, _),)) = solved[2], ran[2]
    assert (summary["steps"], summary["refused"]) == (60, {})
    assert ran[0] == 0
    assert ran[1].startswith("note: not used: ")
    assert live["steps"] == 60 - live["refused"]["features_late"] < 60


def test_bad_stamps_are_counted_and_the_second_pass_is_clean_and_has_its_map(both, bag, tmp_path):
    (tmp_path / "bag").symlink_to(bag)
    anew = from_half_on_anew(bag)

    def change(topic, index, message):
        message = anew(topic, index, message)
        if (topic, index) in ((FEATURES.recorded, 11), (TWIST.recorded, 21)):
            message.header.stamp.sec = 2**31 - 1 if topic == TWIST.recorded else 7
        return message

    solved, ran = both(rewritten(tmp_path / "bag", change))
    assert solved[:2] == ran[:2]
    assert (solved[0], [summary["steps"] for summary, _ in solved[2]]) == (0, [29, 30])
    for (one, trajectory), (other, other_trajectory) in zip(solved[2], ran[2], strict=True):
        assert (one["steps"], one["complete"]) == (other["steps"], other["complete"])
        assert trajectory == other_trajectory
    for _, _, (_, (last, _)) in (solved, ran):
        assert last["refused"] == {"features_bad_stamp": 1, "twist_bad_stamp": 1}
    for command in ("solve", "run"):
        for folder in pass_directories(tmp_path / command):
            assert main(["verify", str(folder)]) == 0


def test_a_dataset_is_run_in_the_frames_of_the_parameters(both, dataset, tmp_path):
    params = tmp_path / "params.yaml"
    frames = "base_frame: car, odom_frame: start"
    params.write_text(
        f"imu_prediction_node: {{ros__parameters: {{{frames}}}}}\n"
        f"slam_node: {{ros__parameters: {{{frames}, camera_frame: cam, estimator: mapping}}}}\n"
    )
    solved, ran = both(dataset, "--params", params)
    assert_same_end(solved, ran)
    assert solved[0] == 0


def test_a_bag_under_other_names_fails_at_once_in_the_same_words(tmp_path, capsys):
    bag, lines = case("06_namespace"), set()
    for command in ("solve", "run"):
        argv = [command, str(bag), "--out", str(tmp_path / command)]
        assert main(argv) == 1
        lines.add(capsys.readouterr().err)
        assert not (tmp_path / command).exists()
    (line,) = lines
    assert "has no topic /stereo/left/camera_info" in line
    assert line.endswith("it has it in the namespace /robot1: give that with --namespace\n")


def test_camera_infos_that_nobody_keeps_are_heard(both):
    solved, ran = both(case("03_camera_info_volatile"))
    assert_same_end(solved, ran)
    code, line, ((summary, _),) = solved
    assert (code, line, summary["steps"], summary["refused"]) == (0, "", 60, {})


def test_one_robot_of_a_bag_is_solved_and_run_whatever_its_topics_are_called(
    both, bag, dataset, tmp_path
):
    """In simulated time, and with calibrations that are sent once and kept for nobody."""
    (tmp_path / "bag").symlink_to(bag)
    fleet = rewritten(
        tmp_path / "bag",
        unchanged,
        rename=lambda topic: "/speed" if topic == TWIST.recorded else f"/fleet/one{topic}",
        latches=False,
    )
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {use_sim_time: true}}\n")
    flags = ("--namespace", "fleet/one", "--remap", "imu/twist:=/speed", "--params", params)
    solved, ran = both(fleet, *flags)
    assert_same_end(solved, ran)
    assert solved[0] == 0
    assert main(["solve", str(dataset), "--out", str(tmp_path / "plain")]) == 0
    assert solved[2][0][1] == (tmp_path / "plain" / "trajectory.tum").read_bytes()


@pytest.mark.parametrize("command", ["solve", "run"])
def test_a_dataset_has_no_topics_to_remap(dataset, tmp_path, capsys, command):
    argv = [command, str(dataset), "--out", str(tmp_path / "out"), "--remap", "imu/twist:=/speed"]
    assert main(argv) == 1
    assert "small.npz: is no bag: leave out --remap" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
