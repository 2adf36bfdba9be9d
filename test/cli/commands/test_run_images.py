# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images go through the live graph, the tracker among its processes, to the bytes of solve."""

from pathlib import Path

import numpy as np
import pytest
from imagery.bags import OURS, REALSENSE, drive_messages, write_messages
from imagery.folders import FRAMES, write_asl, write_dataset, write_kitti_odometry

from vislam_ros.cli.main import main
from vislam_ros.data.results.reader import read_results

FILES = ("trajectory.tum", "dead_reckoning.tum")


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of simulated images, of lenses that bend and cameras that look aside."""
    path = tmp_path_factory.mktemp("hall") / "hall"
    words = ["simulate", str(path), "--images", "--scene", "room"]
    assert main([*words, "--seconds", "1", "--rate", "10"]) == 0
    return path


def assert_same(run, solved: Path, steps: int) -> None:
    code, output, errors = run.end()
    assert code == 0, errors
    assert "complete" in output
    run.assert_nothing_is_left()
    for name in FILES:
        assert (run.out / name).read_bytes() == (solved / name).read_bytes(), name
    summary = run.summary()
    assert (summary["steps"], summary["refused"]) == (steps, {})


def test_raw_images_and_their_bag_give_the_offline_trajectory(start, hall, tmp_path):
    bag, solved, of_bag = tmp_path / "hall_bag", tmp_path / "solved", tmp_path / "of_bag"
    assert main(["convert", str(hall), str(bag)]) == 0
    assert main(["verify", str(bag)]) == 0
    runs = [
        start(hall, "--rate", "0", name="folder"),
        start(bag, "--rate", "2", name="bag"),
    ]
    assert main(["solve", str(hall), "--out", str(solved)]) == 0
    assert main(["solve", str(bag), "--out", str(of_bag)]) == 0
    for name in FILES:
        assert (of_bag / name).read_bytes() == (solved / name).read_bytes(), name
    for run in runs:
        assert_same(run, solved, 11)
        assert (run.out / "log" / "stereo_tracker_node.log").is_file()
        used = read_results(run.out).parameters["stereo_tracker_node"]
        assert (used["gyroscope"], used["queue_size"]) == ("required", 0)
        assert main(["verify", str(run.out)]) == 0


def test_motion_from_elsewhere_and_settings_of_the_tracker_reach_both(start, tmp_path):
    images, motion = write_kitti_odometry(tmp_path / "06"), write_dataset(tmp_path / "motion.npz")
    params = tmp_path / "few.yaml"
    params.write_text("stereo_tracker_node: {ros__parameters: {max_features: 12}}\n")
    flags = ("--motion", str(motion), "--params", str(params))
    run = start(images, "--rate", "0", *flags)
    solved = tmp_path / "solved"
    assert main(["solve", str(images), *flags, "--out", str(solved)]) == 0
    assert_same(run, solved, FRAMES)
    assert max(read_results(run.out).steps["observed"]) <= 12


@pytest.mark.parametrize("driver", ["compressed", "realsense"])
def test_a_driver_s_bag_is_run_with_one_command(start, driver, tmp_path):
    if driver == "realsense":
        bag = write_messages(tmp_path / "bag", drive_messages(REALSENSE))
    else:
        sides = {side: f"{OURS[side]}/compressed" for side in ("left", "right")}
        names = {**OURS, **sides, "imu": "/imu/data"}
        messages = drive_messages(names, compressed=True)
        for name, _, _, message in messages:
            if name == "/imu/data":
                message.header.frame_id = "base_link"
        bag = write_messages(tmp_path / "bag", messages)
    run = start(bag, "--rate", "0")
    assert main(["solve", str(bag), "--out", str(tmp_path / "solved")]) == 0
    assert_same(run, tmp_path / "solved", FRAMES)


def test_tracks_can_be_made_before_the_run(start, tmp_path):
    images = write_asl(tmp_path / "V1_01")
    run = start(images, "--rate", "0", "--tracks")
    solved = tmp_path / "solved"
    assert main(["solve", str(images), "--out", str(solved)]) == 0
    assert_same(run, solved, FRAMES)
    assert not (run.out / "log" / "stereo_tracker_node.log").exists()


def test_a_body_that_stands_tilted_is_levelled_live_as_offline(start, tmp_path):
    images = write_asl(tmp_path / "V1_01")
    table = images / "mav0" / "imu0" / "data.csv"
    table.write_text(table.read_text().replace(",0.0,0.0,9.81", ",2.0,-1.0,9.552"))
    run = start(images, "--rate", "0")
    solved = tmp_path / "solved"
    assert main(["solve", str(images), "--out", str(solved)]) == 0
    assert_same(run, solved, FRAMES)
    first = read_results(run.out).trajectory.T_world_body[0]
    np.testing.assert_allclose(9.81 * first[2, :3], (2.0, -1.0, 9.552), atol=0.01)


def test_images_of_another_clock_than_the_motion_are_refused_as_offline(tmp_path, capsys):
    names = {role: name for role, name in OURS.items() if role != "twist"} | {"imu": "/imu/data"}
    messages = drive_messages(names)
    for topic, _, _, message in messages:
        if topic in (OURS["left"], OURS["right"]):
            message.header.stamp.sec -= 1_000_000
        elif topic == "/imu/data":
            message.header.frame_id = "base_link"
    bag = write_messages(tmp_path / "bag", messages)
    said = []
    for words in (["solve", str(bag)], ["run", str(bag), "--no-pictures", "--rate", "0"]):
        assert main([*words, "--out", str(tmp_path / "out")]) == 1
        said.append(capsys.readouterr().err)
        assert not (tmp_path / "out").exists()
    assert said[0] == said[1]
    assert "both must tell the time by one clock" in said[0]
