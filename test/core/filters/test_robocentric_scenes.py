# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the robocentric filter makes of a few points: far, near, passed, wrong, and unforeseen."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from dense_state import TWIST
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scenes import STANDING, frame_of

from vislam_ros.core.filters.robocentric import RobocentricFilter
from vislam_ros.core.filters.robocentric_model import SIZE
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.motion import FIRST_TWIST_STD, Increment, Part
from vislam_ros.data.simulation.simulate import BASELINE, INTRINSICS, T_BODY_CAMERA

Array = NDArray[np.float64]

CAMERA = StereoCamera.from_matrices(INTRINSICS, BASELINE, T_BODY_CAMERA)
SECONDS = 0.1


def increment(twist: Array) -> Increment:
    T = se3.exp(SECONDS * twist)
    return Increment(T, SECONDS, np.zeros((6, 6)), (Part(SECONDS, twist),))


def filter_that_sees(
    points_body: Array, twist: Array, steps: int, **settings: Any
) -> RobocentricFilter:
    """Drive past points (n, 3) at a constant twist, which the filter is told with noise."""
    twist_rng, pixel_rng = map(np.random.default_rng, (11, 12))
    filter_ = RobocentricFilter(RobocentricSettings(**settings), CAMERA)
    keys = np.arange(len(points_body))
    for k in range(steps):
        noisy = twist + np.repeat([0.5, 0.05], 3) * twist_rng.standard_normal(6)
        in_view, pixels = seen_from(se3.exp(k * SECONDS * twist), points_body)
        pixels += pixel_rng.standard_normal(pixels.shape)
        filter_.step(increment(noisy) if k else STANDING, frame_of(keys[in_view], pixels))
        assert_sound(filter_)
    return filter_


def seen_from(T_world_body: Array, points: Array) -> tuple[NDArray[np.bool_], Array]:
    """Which points (n, 3) of the world are in view, and the pixels (m, 4) of those."""
    T = se3.inverse(T_world_body @ CAMERA.T_body_camera)
    seen = points @ T[:3, :3].T + T[:3, 3]
    y = CAMERA.project(seen)
    in_view = (seen[:, 2] > 0.1) & np.all((y > 0) & (y < [1242, 1242, 375]), axis=1)
    return in_view, y[in_view][:, [0, 2, 1, 2]]


def assert_sound(filter_: RobocentricFilter) -> None:
    for values in (
        filter_.T_world_body,
        filter_.vehicle.twist,
        filter_.vehicle.gyro_bias,
        filter_.vehicle.kappa,
        filter_.image_points,
        filter_.covariance,
        *filter_.landmarks(),
    ):
        assert np.all(np.isfinite(values))
    variances = np.linalg.eigvalsh(filter_.covariance)
    assert variances[0] > -1e-12 * variances[-1]


def far_points(count: int, distance: float) -> Array:
    rng = np.random.default_rng(12)
    across = rng.uniform(-0.5, 0.5, (count, 2)) * [1.0, 0.3]
    return distance * np.column_stack([np.ones(count), across])


FORWARD = np.array([8.0, 0, 0, 0, 0, 0.05])
NOTHING = frame_of(np.arange(0), np.empty((0, 4)))


def test_points_at_infinity_with_zero_and_negative_disparities_tell_the_rotation() -> None:
    points = far_points(40, 1e6)
    seeing = filter_that_sees(points, FORWARD, 30)
    disparity = seeing.image_points[:, 0] - seeing.image_points[:, 1]
    assert np.sum(disparity <= 0) > 10
    assert seeing.active == 40
    blind = filter_that_sees(points[:0], FORWARD, 30)
    assert_better(blind, seeing, slice(3, 6), 20)
    # They say nothing of the way gone.
    assert seeing.pose_covariance[0, 0] > 0.5 * blind.pose_covariance[0, 0]
    # What lies at no distance has no place on the map.
    assert seeing.landmark_count < 10


def assert_better(
    worse: RobocentricFilter, better: RobocentricFilter, part: slice, ratio: float
) -> None:
    variances = [np.diag(filter_.pose_covariance)[part] for filter_ in (worse, better)]
    assert np.all(variances[0] > ratio * variances[1])
    true = se3.exp(29 * SECONDS * FORWARD)
    error = se3.log(se3.inverse(better.T_world_body) @ true)[part]
    assert np.all(np.abs(error) < 4 * np.sqrt(variances[1]))


def test_near_points_tell_the_way_gone() -> None:
    rng = np.random.default_rng(13)
    points = np.column_stack(
        [rng.uniform(10, 60, 120), rng.uniform(-8, 8, 120), rng.uniform(-2, 3, 120)]
    )
    blind = filter_that_sees(points[:0], FORWARD, 30)
    assert_better(blind, filter_that_sees(points, FORWARD, 30), slice(0, 6), 3)


def test_a_landmark_that_the_body_passes_is_mapped_where_it_stands() -> None:
    beside = np.array([[9.0, 1.5, 0.5]])
    points = np.concatenate([beside, far_points(20, 60.0)])
    before = filter_that_sees(points, FORWARD, 9)
    assert 0 in before.keys
    # It is out of view for the last of them, but nobody said that its track had ended.
    after = filter_that_sees(points, FORWARD, 15, lens_distortion_std=0.0)
    assert 0 not in after.keys
    keys, positions, covariances = after.landmarks()
    (row,) = np.flatnonzero(keys == 0)
    error = positions[row] - beside[0]
    assert error @ np.linalg.solve(covariances[row], error) < 16


def test_what_is_seen_of_a_landmark_behind_the_camera_is_rejected_and_begins_no_landmark() -> None:
    near = np.array([[3.0, 0.5, 0.0], [4.0, -0.5, 0.0]])
    filter_ = filter_that_sees(np.concatenate([near, far_points(20, 60.0)]), FORWARD, 1)
    y = filter_.image_points
    seen = np.arange(1, 22)
    # Both are left behind by 6 m; one of them is in the frame all the same.
    outcome = filter_.step(increment(7.5 * FORWARD), frame_of(seen, y[seen][:, [0, 2, 1, 2]]))
    assert 1 in outcome.rejected
    assert 0 not in outcome.rejected
    assert outcome.admitted == 0
    assert not {0, 1} & set(filter_.keys.tolist())
    # Under another name it may begin.
    assert filter_.step(STANDING, frame_of([50], y[1:2, [0, 2, 1, 2]])).admitted == 1


def test_where_the_innovations_covariance_is_not_positive_landmarks_are_given_up() -> None:
    points = far_points(30, 40.0)
    filter_ = filter_that_sees(points, FORWARD, 20, chi2_gate=0.0)
    small = filter_.covariance[:SIZE, :SIZE].copy()
    # Two landmarks that are more than one: what rounding might do at its worst.
    filter_.covariance[SIZE, SIZE + 3] = filter_.covariance[SIZE + 3, SIZE] = 1e3
    pixels = filter_.image_points[:, [0, 2, 1, 2]]
    outcome = filter_.step(STANDING, frame_of(filter_.keys, pixels))
    assert outcome.used == 0
    np.testing.assert_array_equal(np.sort(outcome.rejected), np.arange(30))
    assert filter_.active == 0
    np.testing.assert_array_equal(filter_.covariance, small)
    # Nothing that it saw fitted: the twist may change by ten of its deviations, and nothing else.
    filter_.step(STANDING, NOTHING)
    doubted = small.diagonal().copy()
    doubted[TWIST] *= 100.0
    np.testing.assert_allclose(filter_.covariance.diagonal(), doubted, rtol=1e-12)
    off_diagonal = ~np.eye(SIZE, dtype=bool)
    np.testing.assert_array_equal(filter_.covariance[off_diagonal], small[off_diagonal])
    # It goes on with others.
    for _ in range(3):
        outcome = filter_.step(increment(FORWARD), frame_of(np.arange(100, 130), pixels))
        assert_sound(filter_)
    assert outcome.used + len(outcome.rejected) == 30


def moving_off(seed: int) -> float:
    """Squared distance of the pose from the truth a second after a body that stood moved off."""
    points, rng = far_points(30, 40.0), np.random.default_rng(seed)
    filter_ = filter_that_sees(points, 0.0 * FORWARD, 100)
    T_world_body = np.eye(4)
    for share in (0.2, 0.4, 0.6, 0.8, *[1.0] * 5):
        twist = share * np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.2])
        T_world_body = T_world_body @ se3.exp(SECONDS * twist)
        in_view, pixels = seen_from(T_world_body, points)
        pixels += rng.standard_normal(pixels.shape)
        measured = twist + np.repeat([0.5, 0.05], 3) * rng.standard_normal(6)
        filter_.step(increment(measured), frame_of(np.flatnonzero(in_view), pixels))
    error = se3.log(se3.inverse(filter_.T_world_body) @ T_world_body)
    return float(error @ np.linalg.solve(filter_.pose_covariance, error))


def test_a_body_that_stood_and_moves_off_is_where_the_filter_says() -> None:
    # Of six poses with six numbers each; more in one case of a thousand.
    assert sum(moving_off(seed) for seed in range(6)) < 67.98


def test_a_twist_that_is_contradicted_again_and_again_is_no_less_known_than_at_the_start() -> None:
    points = far_points(30, 40.0)
    filter_ = filter_that_sees(points, FORWARD, 10)
    for k in range(6):
        pixels = filter_.image_points[:, [0, 2, 1, 2]] + 300.0 * (-1.0) ** k
        outcome = filter_.step(STANDING, frame_of(filter_.keys, pixels))
        assert outcome.is_contradicted or outcome.admitted == len(filter_.keys)
        variances = filter_.covariance.diagonal()[TWIST]
        assert np.all(variances <= 1.01 * FIRST_TWIST_STD**2)


def test_a_non_finite_observation_is_rejected() -> None:
    filter_ = filter_that_sees(far_points(30, 40.0), FORWARD, 10)
    pixels = filter_.image_points[:, [0, 2, 1, 2]].copy()
    pixels[3, 1] = np.nan
    outcome = filter_.step(increment(0 * FORWARD), frame_of(filter_.keys, pixels))
    assert 3 in outcome.rejected
    assert filter_.active == 30 - len(outcome.rejected)
    assert_sound(filter_)


@pytest.mark.parametrize(
    ("twist", "disparity"),
    [
        ([80.0, 0, 0, 0, 0, 0], 60.0),
        ([5.0, 0, 0, 0, 0, 15.0], 10.0),
        ([5.0, 0, 0, 0, 0, 0], -300.0),
        ([0.0, 0, 0, 0, 0, 31.0], 10.0),
        ([0.0, 0, 0, 0, 0, 0], 0.0),
    ],
)
@pytest.mark.parametrize("chi2_gate", [16.27, 0.0])
@pytest.mark.parametrize("pixel_noise", [1.0, 200.0])
def test_absurd_input_leaves_the_estimate_finite(
    twist: list[float], disparity: float, chi2_gate: float, pixel_noise: float
) -> None:
    rng = np.random.default_rng(14)
    u, v = rng.uniform(100, 1100, 20), rng.uniform(50, 300, 20)
    filter_ = RobocentricFilter(RobocentricSettings(chi2_gate=chi2_gate), CAMERA)
    for _ in range(20):
        pixels = np.column_stack([u, v, u - disparity, v])
        pixels += pixel_noise * rng.standard_normal(pixels.shape)
        filter_.step(increment(np.array(twist)), frame_of(np.arange(20), pixels))
        assert_sound(filter_)


def test_a_step_of_many_samples_is_as_many_steps_without_a_frame() -> None:
    twists = np.array([[8.0, 0.1, 0.0, 0.01, 0.02, 0.3]]) + 0.01 * np.arange(7.0)[:, None]
    points = far_points(8, 40.0)
    one, many = (filter_that_sees(points, FORWARD, 5) for _ in range(2))
    steps = [increment(twist) for twist in twists]
    steps[3] = dataclasses.replace(steps[3], parts=(Part(SECONDS, None),))
    for step in steps:
        many.step(step, NOTHING)
    parts = tuple(part for step in steps for part in step.parts)
    one.step(Increment(np.eye(4), SECONDS, np.zeros((6, 6)), parts), NOTHING)
    assert_allclose(one.T_world_body, many.T_world_body, atol=1e-12)
    assert_allclose(one.covariance, many.covariance, rtol=1e-9, atol=1e-12)


def test_a_manoeuvre_while_no_frame_comes_is_followed() -> None:
    filter_ = filter_that_sees(far_points(8, 40.0), FORWARD, 30)
    turning = increment(FORWARD + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    parts = increment(FORWARD).parts + 2 * turning.parts
    filter_.step(Increment(np.eye(4), 3 * SECONDS, np.zeros((6, 6)), parts), NOTHING)
    assert_allclose(filter_.vehicle.body_twist[5], 1.0, atol=0.1)


def test_while_frames_come_a_measured_twist_that_leaps_is_mostly_noise() -> None:
    filter_ = filter_that_sees(far_points(8, 40.0), FORWARD, 30)
    y = filter_.image_points[:, [0, 2, 1, 2]]
    leap = increment(FORWARD + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    filter_.step(leap, frame_of(filter_.keys, y))
    assert abs(filter_.vehicle.body_twist[5]) < 0.2


def test_without_a_sample_the_twist_goes_on_and_is_known_the_less_the_longer_it_takes() -> None:
    filter_ = filter_that_sees(far_points(8, 40.0), FORWARD, 20)
    before, std = filter_.vehicle.twist, []
    for _ in range(3):
        filter_.step(
            Increment(np.eye(4), SECONDS, np.zeros((6, 6)), (Part(SECONDS, None),)),
            NOTHING,
        )
        std.append(np.sqrt(np.diag(filter_.covariance)[TWIST]))
    assert_allclose(filter_.vehicle.twist, before)
    assert np.all(np.diff(std, axis=0) > 0)
