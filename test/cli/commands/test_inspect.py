# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam inspect``: files of each kind, with faults and without."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imagery.folders import write_asl, write_kitti_odometry
from places import SHARED_CASES

from vislam_ros.cli.main import main

FOUND = {
    "0020": {"twist_origin", "frozen_steps", "moving_tracks"},
    "0022": {"twist_origin", "frozen_steps", "disparities", "gyro_bias", "moving_tracks"},
    "03": {"imu_frame", "frozen_steps", "disparities", "gyro_bias", "moving_tracks"},
}


def inspected(path: Path, capsys: pytest.CaptureFixture[str], code: int = 0) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["inspect", str(path), "--json"]) == code
    told = json.loads(capsys.readouterr().out)
    assert isinstance(told, dict)
    assert told["usable"] is (code == 0)
    return told


def names(told: dict[str, Any]) -> set[str]:
    return {each["name"] for each in told["findings"]}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inspect") / "drive.npz"
    quiet = ["--gyro-bias", "0", "0", "0", "--outliers", "0", "--steps", "200"]
    assert main(["simulate", str(path), "--landmarks", "2000", *quiet]) == 0
    return path


def altered(drive: Path, path: Path, **arrays: Any) -> Path:
    with np.load(drive) as content:
        np.savez(path, **{**content, **arrays})
    return path


def test_a_clean_dataset_and_its_bag_have_no_findings(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    assert main(["convert", str(drive), str(bag)]) == 0
    of_dataset, of_bag = inspected(drive, capsys), inspected(bag, capsys)
    assert names(of_dataset) == names(of_bag) == set()
    assert of_dataset["facts"]["steps"] == of_bag["facts"]["steps"] == 200
    assert set(of_bag["streams"]) >= {"/imu/twist", "/stereo/features"}


def test_faults_of_a_dataset_are_found_alone(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(drive) as content:
        features, stamps = content["features"], content["time_stamps"].copy()
        mount = next(key for key in ("imu_T_cam", "cam_T_imu") if key in content)
        T = content[mount]
    seen = np.any(features != -1, axis=0)
    halved = np.where(seen, 0.5 * features, -1.0)
    stamps.ravel()[[20, 90]] = stamps.ravel()[[90, 20]]
    turned = np.diag([1.0, -1.0, -1.0, 1.0]) @ T if mount == "imu_T_cam" else T
    for name, arrays, code in (
        ("left_right_swapped", {"features": features[[2, 3, 0, 1]]}, 0),
        ("pixel_scale", {"features": halved}, 0),
        ("extrinsics_inverted", {mount: np.linalg.inv(T)}, 0),
        ("imu_frame", {mount: turned}, 0),
        ("stamps", {"time_stamps": stamps}, 1),
    ):
        path = altered(drive, tmp_path / f"{name}.npz", **arrays)
        assert names(inspected(path, capsys, code)) == {name}


def test_the_tables_fit_a_page(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["inspect", str(drive)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("nothing wrong was found" in line for line in lines)
    assert max(map(len, lines[1:])) <= 80


def test_a_finding_and_what_was_done_stand_on_lines_of_their_own(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(drive) as content:
        features = content["features"][[2, 3, 0, 1]]
    assert main(["inspect", str(altered(drive, tmp_path / "swapped.npz", features=features))]) == 0
    told = capsys.readouterr().out
    (advice,) = (line for line in told.splitlines() if "done: " in line or "to do: " in line)
    assert advice.split("│")[2].strip().startswith(("done: ", "to do: "))
    assert "\\n" not in told


@pytest.mark.parametrize("command", ["solve", "convert"])
def test_commands_that_take_the_data_say_what_is_wrong_with_the_images_in_a_line(
    command: str, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(drive) as content:
        features = content["features"][[2, 3, 0, 1]]
    swapped = altered(drive, tmp_path / "swapped.npz", features=features)
    where = ["--out", str(tmp_path / "out")] if command == "solve" else [str(tmp_path / "bag")]
    main([command, str(swapped), *where])
    notes = [line for line in capsys.readouterr().err.splitlines() if "left_right_swapped" in line]
    assert len(notes) == 1
    assert notes[0].startswith("note: left_right_swapped: ")


def test_a_file_that_is_none_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(tmp_path / "none.npz")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_images_are_told_with_the_findings_of_their_tracks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = inspected(write_asl(tmp_path / "V1_01"), capsys)
    assert told["kind"] == "images"
    assert told["facts"]["encodings"] == ["mono8"]
    assert told["facts"]["tracks"] > 0
    without = inspected(write_kitti_odometry(tmp_path / "06"), capsys)
    assert "nothing tells the motion" in without["not_judged"]["contradiction"]


@pytest.mark.parametrize("name", FOUND)
def test_real_drives_have_what_they_have(
    name: str, shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert names(inspected(shared_data / f"{name}.npz", capsys)) == FOUND[name]


def test_a_real_gyroscope_bias_is_measured_in_thirty_images(
    shared_images: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (finding,) = inspected(shared_images / "euroc_v101", capsys)["findings"]
    assert finding["name"] == "gyro_bias"
    np.testing.assert_allclose(
        finding["numbers"]["bias_rad_s"], [-0.0022, 0.0215, 0.0770], atol=0.003
    )


@pytest.mark.skipif(not SHARED_CASES.is_dir(), reason=f"needs the cases in {SHARED_CASES}")
@pytest.mark.parametrize(
    ("case", "found", "code"),
    [
        ("03_camera_info_volatile", set(), 0),
        ("04_camera_outage_2s", {"stamps"}, 0),
        ("05_zero_stamps", {"stamps"}, 1),
        ("07_inverse_extrinsics", {"extrinsics_inverted"}, 0),
        ("10_last_frame_after_last_twist", set(), 0),
        ("12_log_times_shuffled", {"stamps"}, 0),
    ],
)
def test_cases_are_told_apart(
    case: str, found: set[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert names(inspected(SHARED_CASES / case / "bag", capsys, code)) == found
