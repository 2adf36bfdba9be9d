# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples of the motion with a NaN are left out, and the rest of the motion counts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import evaluate
from vislam_ros.data.image_sources import read_motion
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.errors import VislamError

STEPS = 120
MISSING = [0, 7, 8, 60, STEPS - 1]
LEFT = np.delete(np.arange(STEPS), MISSING)
KEYS = ("linear_velocity", "angular_velocity")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("missing") / "whole.npz"
    write_simulated(path, simulate(steps=STEPS, landmarks=600))
    return path


def with_gaps(whole: Path, path: Path, key: str, **others: Any) -> Path:
    with np.load(whole) as content:
        values = content[key].copy()
        values[1, MISSING] = np.nan
        np.savez(path, **{**content, key: values, **others})
    return path


def assert_left(drive: Drive, whole: Drive) -> None:
    np.testing.assert_array_equal(drive.twists, whole.twists[LEFT])
    np.testing.assert_array_equal(drive.twist_stamps, whole.twist_stamps[LEFT])
    np.testing.assert_array_equal(drive.feature_stamps, whole.feature_stamps)


@pytest.mark.parametrize("key", KEYS)
def test_samples_with_a_nan_are_left_out_and_the_first_is_told(
    whole: Path, tmp_path: Path, key: str
) -> None:
    drive, other = npz.read(with_gaps(whole, tmp_path / "gaps.npz", key)), npz.read(whole)
    assert drive.measures_velocity
    assert_left(drive, other)
    first = stamp_text(int(other.twist_stamps[0]))
    note = f"Left out 5 of 120 samples of motion with a NaN, the first at {first} s."
    assert drive.notes == (*other.notes, note)


def test_a_gyroscope_alone_may_miss_samples_too(whole: Path, tmp_path: Path) -> None:
    unknown = np.full((3, STEPS), np.nan)
    path = with_gaps(whole, tmp_path / "gaps.npz", KEYS[1], **{KEYS[0]: unknown})
    drive = npz.read(path)
    assert not drive.measures_velocity
    assert_left(drive, npz.read(whole).moved_by("gyro"))


def test_the_sample_of_a_nan_is_that_of_its_step_where_twists_are_moved_to_the_steps_end(
    whole: Path, tmp_path: Path
) -> None:
    begins = Conventions(imu_frame="as-given", twist_index="start", twist_origin="body")
    path = with_gaps(whole, tmp_path / "gaps.npz", KEYS[0])
    drive, other = (npz.read(each, conventions=begins) for each in (path, whole))
    # The last sample has no step; the first stands for itself and for its step.
    left = np.delete(np.arange(STEPS), [0, 1, 8, 9, 61])
    np.testing.assert_array_equal(drive.twists, other.twists[left])
    np.testing.assert_array_equal(drive.twist_stamps, other.twist_stamps[left])


def test_axes_are_found_all_the_same(whole: Path, tmp_path: Path) -> None:
    with np.load(whole) as content:
        turned = {key: content[key] * [[1], [-1], [-1]] for key in KEYS}
        np.savez(tmp_path / "frd.npz", **{**content, **turned})
    drive = npz.read(with_gaps(tmp_path / "frd.npz", tmp_path / "gaps.npz", KEYS[0]))
    assert [each.name for each in drive.findings] == ["imu_frame"]
    assert_left(drive, npz.read(whole))


def test_images_want_all_samples_of_a_motion_whose_axes_they_tell(
    whole: Path, tmp_path: Path
) -> None:
    path = with_gaps(whole, tmp_path / "gaps.npz", KEYS[0])
    assert len(read_motion(path).motion.stamps) == len(LEFT)
    with np.load(path) as content:
        arrays = {name: content[name] for name in content if name != "features"}
    np.savez(tmp_path / "motion.npz", **arrays)
    with pytest.raises(VislamError, match="5 of its 120 samples of motion have a NaN"):
        read_motion(tmp_path / "motion.npz")


@pytest.mark.parametrize("key", KEYS)
def test_a_few_of_them_cost_next_to_nothing(whole: Path, tmp_path: Path, key: str) -> None:
    path = with_gaps(whole, tmp_path / "gaps.npz", key)
    truth = whole.with_suffix(".tum")
    errors = [evaluate(solve(each).trajectory, truth).ate.rmse for each in (path, whole)]
    assert errors[0] < 1.2 * errors[1]
