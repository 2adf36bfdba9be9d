# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses
from typing import Any

import numpy as np
import pytest
from benchmark.battery.changes import quarter_of, with_clean_twist, with_sliding_tracks
from benchmark.recorded_drive import twist_errors
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.trajectory import Trajectory

SETTINGS = SimulationSettings(
    steps=1201,
    landmarks=3000,
    velocity_noise_std=0.5,
    angular_velocity_noise_std=0.05,
    gyro_bias=(0.02, -0.02, 0.02),
    seed=5,
)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(SETTINGS).drive


@pytest.fixture(scope="module")
def truth(drive: Drive) -> Trajectory:
    assert drive.ground_truth is not None
    return drive.ground_truth


def test_quarters_put_together_are_the_drive(drive: Drive) -> None:
    quarters = [quarter_of(drive, quarter) for quarter in (1, 2, 3, 4)]

    def together(name: str) -> Any:
        return np.concatenate([getattr(quarter, name) for quarter in quarters])

    for name in ("twist_stamps", "twists", "feature_stamps", "ids", "pixels"):
        assert_array_equal(together(name), getattr(drive, name), err_msg=name)
    counts = np.concatenate([np.diff(quarter.offsets) for quarter in quarters])
    assert_array_equal(counts, np.diff(drive.offsets))
    assert {quarter.steps for quarter in quarters} == {300, 301}


@pytest.mark.parametrize("biased", [False, True])
def test_a_clean_twist_is_as_noisy_and_as_biased_as_told(
    drive: Drive, truth: Trajectory, biased: bool
) -> None:
    clean = with_clean_twist(drive, truth, np.random.default_rng(1), biased=biased)
    _, errors = twist_errors(clean, truth)
    std = np.repeat([0.03, 0.003], 3)
    assert_allclose(errors.std(axis=0), std, rtol=0.08)
    mean = errors.mean(axis=0)
    assert np.all(np.abs(mean[:3]) < 4 * std[:3] / np.sqrt(len(errors)))
    assert_allclose(np.abs(mean[3:]), 0.01 if biased else 0.0, atol=4 * 0.003 / len(errors) ** 0.5)
    assert_array_equal(clean.pixels, drive.pixels)


def test_a_twist_that_the_reference_does_not_know_is_one_that_it_knows(
    drive: Drive, truth: Trajectory
) -> None:
    known = Trajectory.from_matrices(truth.stamps[300:900], truth.T_world_body[300:900])
    wild = dataclasses.replace(drive, twists=drive.twists + 100.0)
    clean = with_clean_twist(wild, known, np.random.default_rng(1), biased=False)
    assert clean.twists.shape == drive.twists.shape
    assert np.abs(clean.twists).max() < 50.0
    assert_allclose(clean.twists[:301, 0], clean.twists[301, 0], atol=0.3)


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_the_told_share_of_tracks_slides_and_alike_in_both_images(
    drive: Drive, share: float
) -> None:
    slid = with_sliding_tracks(drive, share, np.random.default_rng(2))
    moved = slid.pixels.astype(np.float64) - drive.pixels
    assert_allclose(moved[:, :2], moved[:, 2:], atol=1e-3)
    # A track that is seen once has nowhere to slide.
    tracks, seen = np.unique(drive.ids, return_counts=True)
    sliding = np.isin(tracks, np.unique(drive.ids[np.any(moved != 0, axis=1)]))
    assert np.mean(sliding[seen > 1]) == pytest.approx(share, abs=0.03)
    assert not sliding[seen == 1].any()
    assert_array_equal(slid.ids, drive.ids)


def test_a_sliding_track_goes_the_same_way_from_frame_to_frame(drive: Drive) -> None:
    slid = with_sliding_tracks(drive, 1.0, np.random.default_rng(2))
    moved = slid.pixels.astype(np.float64) - drive.pixels
    tracks, seen = np.unique(drive.ids, return_counts=True)
    of_one = moved[drive.ids == tracks[np.argmax(seen)]]
    assert_allclose(of_one[0], 0.0)
    steps = np.diff(of_one, axis=0)
    assert_allclose(steps, np.tile(steps[:1], (len(steps), 1)), atol=1e-3)
    assert 0.3 * 2.0 <= np.linalg.norm(steps[0, :2]) <= 6.0
