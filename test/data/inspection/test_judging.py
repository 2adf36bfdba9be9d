# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Each fault is found in a drive that has it, and none in one that has not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets.conventions import AS_FOUND, settle_conventions
from vislam_ros.data.datasets.mending import inverted
from vislam_ros.data.drive import Drive
from vislam_ros.data.inspection.judging import judge
from vislam_ros.data.inspection.right_camera import judge_pairs
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

CLEAN = SimulationSettings(
    steps=300, landmarks=3000, gyro_bias=(0.0, 0.0, 0.0), outlier_share=0.0, seed=3
)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(CLEAN).drive


def names(drive: Drive) -> list[str]:
    return [each.name for each in judge(drive).findings]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("disparity_offset_std", [0.0, 1.0])
def test_nothing_is_found_in_a_drive_without_faults(
    seed: int, disparity_offset_std: float
) -> None:
    settings = replace(CLEAN, seed=seed, disparity_offset_std=disparity_offset_std)
    judged = judge(simulate(settings).drive)
    assert not judged.findings
    assert not judged.unknown


def scaled(drive: Drive, scale: float) -> Drive:
    return replace(drive, pixels=(drive.pixels * np.float32(scale)))


def test_exchanged_sides_are_found_whatever_else_is_wrong(drive: Drive) -> None:
    assert names(replace(drive, pixels=drive.pixels[:, [2, 3, 0, 1]])) == ["left_right_swapped"]


def test_faults_of_the_images_show_without_any_motion(drive: Drive) -> None:
    still = replace(drive, twist_stamps=drive.twist_stamps[:0], twists=drive.twists[:0])
    assert not judge_pairs(still)
    exchanged = replace(
        still, pixels=drive.pixels[:, [2, 3, 0, 1]] + np.array([0, 0, 0, 2], np.float32)
    )
    found = [each.name for each in judge_pairs(exchanged)]
    assert found == ["left_right_swapped", "right_camera"]
    nothing = replace(still, ids=drive.ids[:0], pixels=drive.pixels[:0], offsets=0 * drive.offsets)
    assert not judge_pairs(nothing)


@pytest.mark.parametrize("scale", [0.5, 2.0, 0.25])
def test_pixels_of_another_size_are_found(drive: Drive, scale: float) -> None:
    (finding,) = judge(scaled(drive, scale)).findings
    assert finding.name == "pixel_scale"
    assert finding.numbers["scale"] == pytest.approx(1.0 / scale)


def test_pixels_of_another_size_are_found_by_the_gyroscope_alone(drive: Drive) -> None:
    twists = drive.twists.copy()
    twists[:, :3] = np.nan
    alone = replace(drive, twists=twists)
    assert names(alone) == []
    assert names(scaled(alone, 0.5)) == ["pixel_scale"]


def with_right_camera(drive: Drive, focal_length: float, row: float = 0.0) -> Drive:
    """Drive whose right camera has a focal length that is more by so many pixels."""
    camera: StereoCamera = drive.camera
    pixels = drive.pixels.astype(float)
    pixels[:, 2] += (pixels[:, 2] - camera.cx) / camera.fx * focal_length
    pixels[:, 3] += (pixels[:, 3] - camera.cy) / camera.fy * focal_length + row
    return replace(drive, pixels=pixels.astype(np.float32))


@pytest.mark.parametrize(("focal_length", "row"), [(10.0, 0.0), (-3.0, 0.0), (0.0, 2.0)])
def test_a_right_camera_that_is_not_as_told_is_found(
    drive: Drive, focal_length: float, row: float
) -> None:
    (finding,) = judge(with_right_camera(drive, focal_length, row)).findings
    assert finding.name == "right_camera"
    assert finding.numbers["focal_length_px"] == pytest.approx(focal_length, abs=0.7)
    assert finding.numbers["rows_px"] == pytest.approx(row, abs=0.2)


def test_one_that_is_a_little_off_is_none(drive: Drive) -> None:
    assert names(with_right_camera(drive, 0.3, 0.2)) == []


def test_inverted_extrinsics_are_found(drive: Drive) -> None:
    (finding,) = judge(replace(drive, camera=inverted(drive.camera))).findings
    assert (finding.name, finding.is_repaired) == ("extrinsics_inverted", False)
    assert "px with the inverse of the extrinsics" in finding.words
    assert finding.advice == "give the inverse of the extrinsics"


def test_what_an_angular_velocity_in_degrees_spoils_is_not_found_beside_it(drive: Drive) -> None:
    degrees = drive.twists * np.repeat([1.0, np.rad2deg(1.0)], 3)
    settled = settle_conventions(replace(drive, twists=degrees), AS_FOUND)
    assert names(settled) == ["contradiction"]


def test_axes_that_differ_are_found_where_reading_has_not_turned_them(drive: Drive) -> None:
    turned = drive.twists * np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    (finding,) = [
        each for each in judge(replace(drive, twists=turned)).findings if each.name != "gyro_bias"
    ]
    assert (finding.name, finding.is_repaired) == ("imu_frame", False)


@pytest.mark.parametrize("bias", [(0.003, -0.003, 0.003), (-0.01, -0.01, -0.01)])
def test_a_bias_of_the_gyroscope_is_found_and_measured(bias: tuple[float, float, float]) -> None:
    (finding,) = judge(simulate(replace(CLEAN, gyro_bias=bias)).drive).findings
    assert finding.name == "gyro_bias"
    errors = np.array(finding.numbers["bias_rad_s"]) - bias
    assert np.all(np.abs(errors) < 4 * np.array(finding.numbers["std_rad_s"]))


def test_tracks_that_slide_are_found() -> None:
    (finding,) = judge(simulate(replace(CLEAN, outlier_share=0.05)).drive).findings
    assert finding.name == "moving_tracks"
    assert 0.01 < finding.numbers["share"] < 0.05


def test_frozen_steps_are_found_and_counted() -> None:
    simulated = simulate(replace(CLEAN, frozen_share=0.1))
    (finding,) = judge(simulated.drive).findings
    assert finding.name == "frozen_steps"
    assert finding.numbers["frozen"] == simulated.frozen.sum()


def test_wrong_matches_are_found_by_their_disparities(drive: Drive) -> None:
    rng = np.random.default_rng(0)
    pixels = drive.pixels.copy()
    wrong = rng.choice(len(pixels), len(pixels) // 500, replace=False)
    pixels[wrong, 2] = pixels[wrong, 0] + 40
    assert "disparities" in names(replace(drive, pixels=pixels))


def test_two_faults_at_once_are_both_found(drive: Drive) -> None:
    both = replace(scaled(drive, 0.5), camera=inverted(drive.camera))
    assert names(both) == ["pixel_scale", "extrinsics_inverted"]


def part(drive: Drive, keep: NDArray[np.bool_]) -> Drive:
    counts = np.add.reduceat(keep, drive.offsets[:-1])
    return replace(
        drive,
        ids=drive.ids[keep],
        pixels=drive.pixels[keep],
        offsets=np.concatenate([[0], np.cumsum(counts)]),
    )


def test_what_few_tracks_do_not_tell_is_said(drive: Drive) -> None:
    judged = judge(part(drive, drive.ids % 60 == 0))
    assert not judged.findings
    assert "gyro_bias" in judged.unknown


def test_without_features_nothing_of_images_is_judged(drive: Drive) -> None:
    empty = replace(
        drive,
        ids=drive.ids[:0],
        pixels=drive.pixels[:0],
        offsets=np.zeros_like(drive.offsets),
    )
    judged = judge(empty)
    assert not judged.findings
    assert {"gyro_bias", "right_camera", "pixel_scale"} <= set(judged.unknown)
