# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint filter over the landmarks in view is the filter over all landmarks ever seen."""

import numpy as np
import pytest
from dense_reference import DenseJointFilter
from numerics import CAMERA
from numpy.typing import NDArray
from scenes import STANDING, frame_of
from tracked_drive import run, trying_drive

from vislam_ros.core.filters.joint import JointFilter, JointSettings
from vislam_ros.data.drive import Drive


@pytest.fixture(scope="module")
def drive() -> Drive:
    return trying_drive(steps=50, landmarks=300, seed=3)


@pytest.mark.parametrize("initialization", ["correlated", "independent"])
@pytest.mark.parametrize("pixel_variance", [(1.0, 1.0, 1.0, 1.0), (1.0, 1.2, 0.9, 1.1)])
@pytest.mark.parametrize("chi2_gate", [16.27, 0.0])
def test_pose_and_active_landmarks_are_the_dense_filters(
    drive: Drive, initialization: str, pixel_variance: tuple[float, ...], chi2_gate: float
) -> None:
    settings = JointSettings(
        landmark_initialization=initialization,
        pixel_variance=pixel_variance,
        chi2_gate=chi2_gate,
        min_disparity=6.0,
        retire_after=2,
        velocity_noise_std=0.1,
        angular_velocity_noise_std=0.01,
    )
    filter_ = JointFilter(settings, drive.camera)
    dense = DenseJointFilter(settings, drive.camera)
    rejected = 0
    for increment, frame, outcome in run(filter_, drive, settings):
        assert sorted(dense.step(increment, frame)) == sorted(outcome.rejected.tolist())
        rejected += len(outcome.rejected)
        np.testing.assert_allclose(filter_.T_world_body, dense.T_world_body, rtol=0, atol=1e-9)
        np.testing.assert_allclose(filter_.pose_covariance, dense.P[:6, :6], rtol=0, atol=1e-9)
        keys, positions, covariances = filter_.landmarks()
        for i in range(len(keys) - filter_.active, len(keys)):
            position, covariance = dense.landmark(int(keys[i]))
            np.testing.assert_allclose(positions[i], position, rtol=0, atol=1e-9)
            np.testing.assert_allclose(covariances[i], covariance, rtol=0, atol=1e-9)
    assert filter_.landmark_count == len(dense.place_of_key) > 200
    assert filter_.active < 120
    assert (rejected > 10) == (chi2_gate > 0)


def test_the_least_disparity_that_is_used_is_the_one_that_is_set() -> None:
    filter_ = JointFilter(JointSettings(min_disparity=6.0), CAMERA)
    pixels = np.array([[600.0, 180.0, 594.0, 180.0], [600.0, 180.0, 594.5, 180.0]])
    assert filter_.step(STANDING, frame_of([4, 5], pixels)).admitted == 1
    assert filter_.keys.tolist() == [4]
    outcome = filter_.step(STANDING, frame_of([4, 5], pixels))
    assert (outcome.used, outcome.admitted, len(outcome.rejected)) == (1, 0, 0)


def image_of(count: int) -> NDArray[np.float64]:
    """Pixels (count, 4) across the image."""
    rng = np.random.default_rng(8)
    u, v, disparity = rng.uniform([100, 60, 20], [1100, 320, 60], (count, 3)).T
    return np.column_stack([u, v, u - disparity, v])


def test_where_the_innovations_covariance_is_not_positive_landmarks_are_given_up() -> None:
    filter_ = JointFilter(JointSettings(chi2_gate=0.0, pixel_gate=0.0), CAMERA)
    pixels = image_of(20)
    filter_.step(STANDING, frame_of(np.arange(20), pixels))
    pose_covariance = filter_.pose_covariance
    # Two landmarks that are more than one: what rounding might do at its worst.
    filter_.covariance[6, 9] = filter_.covariance[9, 6] = 1e6
    outcome = filter_.step(STANDING, frame_of(np.arange(20), pixels))
    assert outcome.used == 0
    assert outcome.rejected.tolist() == list(range(20))
    assert filter_.active == 0
    np.testing.assert_array_equal(filter_.T_world_body, np.eye(4))
    np.testing.assert_array_equal(filter_.pose_covariance, pose_covariance)
    # It goes on with others.
    for _ in range(2):
        outcome = filter_.step(STANDING, frame_of(np.arange(100, 120), pixels))
    assert outcome.used == 20
