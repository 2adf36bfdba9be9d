# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA, difference
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.warp import warp

Array = NDArray[np.float64]


@pytest.fixture
def motion() -> Array:
    return se3.exp([1.2, 0.1, -0.05, 0.01, -0.02, 0.06])


def image_points(disparities: Array) -> Array:
    rng = np.random.default_rng(31)
    u = rng.uniform(100, 1100, len(disparities))
    return np.column_stack([u, u - disparities, rng.uniform(50, 320, len(disparities))])


# Near, far, at infinity, and the impossible negative disparities of real files.
POINTS = image_points(np.array([60.0, 20.0, 5.0, 1.0, 0.1, 0.0, -0.5, -3.0]))


def test_it_is_the_projection_of_the_moved_point(motion: Array) -> None:
    T_new_old = CAMERA.T_camera_body @ se3.inverse(motion) @ CAMERA.T_body_camera
    assert_allclose(warp(CAMERA, POINTS, motion).y, CAMERA.warp(POINTS, T_new_old), rtol=1e-12)


def test_points_with_motions_of_their_own_are_warped_as_one_by_one(motion: Array) -> None:
    motions = np.array([se3.exp(share * se3.log(motion)) for share in np.linspace(0, 1, 8)])
    together = warp(CAMERA, POINTS, motions)
    for i, alone in enumerate(warp(CAMERA, POINTS, each) for each in motions):
        for name, values in vars(together).items():
            assert_allclose(values[i], getattr(alone, name)[i], rtol=1e-12, atol=1e-12)


def test_its_derivative_by_the_point_is_the_finite_difference(motion: Array) -> None:
    F_y = warp(CAMERA, POINTS, motion).F_y
    for y, F in zip(POINTS, F_y, strict=True):
        numeric = difference(lambda p: warp(CAMERA, p[None], motion).y[0], y, 1e-4)
        assert_allclose(F, numeric, rtol=1e-6, atol=1e-7)


def test_its_derivative_by_the_motion_is_the_finite_difference(motion: Array) -> None:
    G = warp(CAMERA, POINTS, motion).G
    numeric = difference(lambda xi: warp(CAMERA, POINTS, motion @ se3.exp(xi)).y, np.zeros(6))
    assert_allclose(G, numeric, rtol=1e-5, atol=1e-4)


def test_no_motion_changes_nothing() -> None:
    still = warp(CAMERA, POINTS, np.eye(4))
    assert_allclose(still.y, POINTS, rtol=1e-13)
    assert_allclose(still.F_y, np.broadcast_to(np.eye(3), still.F_y.shape), atol=1e-12)


def test_a_point_that_the_body_has_passed_is_not_ahead() -> None:
    passed = warp(CAMERA, image_points(np.array([60.0, 1.0])), se3.exp([10.0, 0, 0, 0, 0, 0]))
    assert passed.ahead.tolist() == [False, True]
    assert np.all(np.isfinite(passed.y))
    assert np.all(np.isfinite(passed.F_y))


def test_a_ray_wider_than_any_lens_is_not_followed() -> None:
    wide = warp(CAMERA, image_points(np.array([20.0])), se3.exp([0, 0, 0, 0, 0, 1.3]))
    assert not wide.ahead[0]
    assert np.all(np.isfinite(wide.y))
