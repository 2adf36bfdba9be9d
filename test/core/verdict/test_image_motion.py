# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.verdict.image_motion import FEWEST_POINTS, image_motion

Array = NDArray[np.float64]

#: Of a car on a straight road, of one in a turn, and of a body that swings round.
MOTIONS = (
    [0.0, 0.0, 0.9, 0.0, 0.002, 0.0],
    [0.1, -0.05, 0.8, 0.003, 0.06, -0.004],
    [0.3, 0.1, -0.2, 0.05, -0.2, 0.1],
)


def points(count: int = 40, seed: int = 3) -> Array:
    """Image points that are 4 to 60 pixels of disparity away."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform([100, 60], [1100, 320], (count, 2)).T
    return np.column_stack([u, u - rng.uniform(4, 60, count), v])


def moved(before: Array, xi: Array) -> Array:
    """Where the camera sees the points after it has moved by ``Exp(xi)``."""
    return CAMERA.warp(before, se3.inverse(se3.exp(xi)))


@pytest.mark.parametrize("xi", MOTIONS)
def test_the_motion_of_exact_points_is_found(xi: list[float]) -> None:
    before = points()
    found = image_motion(CAMERA, before, moved(before, np.array(xi)), np.eye(4))
    assert found.is_one
    assert_allclose(found.xi, xi, atol=1e-6)
    assert_allclose(se3.exp(found.xi), se3.inverse(found.T_new_old), atol=1e-12)


@pytest.mark.parametrize("xi", MOTIONS)
def test_a_third_of_wrong_points_does_not_matter(xi: list[float]) -> None:
    rng = np.random.default_rng(4)
    before = points()
    after = moved(before, np.array(xi)) + 0.3 * rng.standard_normal((40, 3))
    right = image_motion(CAMERA, before[13:], after[13:], np.eye(4))
    after[:13] += rng.uniform(10, 60, (13, 3)) * rng.choice([-1.0, 1.0], (13, 3))
    found = image_motion(CAMERA, before, after, np.eye(4))
    assert found.is_one
    error = found.xi - right.xi
    assert error @ right.metric @ error < 0.1**2


def test_a_motion_far_from_standing_is_found_from_the_one_before() -> None:
    xi = np.array([0.0, 0.2, 3.0, 0.02, 0.5, 0.05])
    before = points()
    before = before[CAMERA.triangulate(before)[:, 2] > 8.0]
    start = se3.inverse(se3.exp(0.9 * xi))
    found = image_motion(CAMERA, before, moved(before, xi), start)
    assert_allclose(found.xi, xi, atol=1e-6)


def test_the_metric_is_the_mean_square_of_how_far_points_move() -> None:
    xi, before = np.array(MOTIONS[1]), points()
    after = moved(before, xi)
    found = image_motion(CAMERA, before, after, np.eye(4))
    for e in 1e-5 * np.eye(6):
        # On the left of the motion of the old frame in the new one, where the search steps.
        T_new_old = se3.exp(e) @ se3.inverse(se3.exp(xi))
        shift = CAMERA.warp(before, T_new_old) - after
        assert_allclose(e @ found.metric @ e, np.mean(np.sum(shift**2, axis=1)), rtol=1e-3)


def test_points_of_mixed_ids_do_not_move_as_one_and_standing_ones_do() -> None:
    rng = np.random.default_rng(5)
    before = points()
    mixed = moved(before, np.array(MOTIONS[0]))[rng.permutation(len(before))]
    assert not image_motion(CAMERA, before, mixed, np.eye(4)).is_one
    noisy = before + rng.standard_normal(before.shape)
    assert image_motion(CAMERA, before, noisy, np.eye(4)).is_one


def test_points_that_tell_nothing_give_numbers_all_the_same() -> None:
    one = np.repeat(points(1), FEWEST_POINTS, axis=0)
    found = image_motion(CAMERA, one, moved(one, np.array(MOTIONS[0])), np.eye(4))
    assert np.all(np.isfinite(found.xi))
    assert np.all(np.isfinite(found.metric))


def test_the_noise_of_disparities_makes_no_motion_shorter() -> None:
    rng, xi = np.random.default_rng(6), np.array(MOTIONS[1])
    before = points(4000)
    before[:, 1] = before[:, 0] - rng.uniform(4, 12, len(before))
    after = moved(before, xi) + 2.0 * rng.standard_normal(before.shape)
    noisy = before + 2.0 * rng.standard_normal(before.shape)
    found = image_motion(CAMERA, noisy, after, np.eye(4))
    assert_allclose(found.xi[2], xi[2], rtol=0.04)
