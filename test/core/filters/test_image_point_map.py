# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA, difference
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.filters.image_point_map import (
    ImagePointMap,
    ImagePoints,
    has_position,
    world_positions,
)
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.lens import radial_shift

SMALL = 7


def points(seed, count=4):
    """Image points of one state, with the covariance (7 + 3 n, 7 + 3 n) that they are cut from."""
    rng = np.random.default_rng(seed)
    half = 0.1 * rng.standard_normal((SMALL + 3 * count, SMALL + 3 * count))
    P = half @ half.T
    left = rng.uniform(100, 1100, count)
    y = np.column_stack([left, left - rng.uniform(5, 60, count), rng.uniform(50, 320, count)])
    rows = SMALL + np.arange(3 * count).reshape(count, 3)
    T = se3.exp(rng.standard_normal(6))
    own = P[rows[:, :, None], rows[:, None, :]]
    return ImagePoints(y, own, P[rows, :SMALL], P[:SMALL, :SMALL], T), P


def positions_of(y, T):
    body = CAMERA.triangulate(y) @ CAMERA.T_body_camera[:3, :3].T + CAMERA.T_body_camera[:3, 3]
    return body @ T[:3, :3].T + T[:3, 3]


def test_positions_and_their_covariances_follow_from_the_finite_differences():
    some, P = points(1)
    found = world_positions(CAMERA, some)
    assert_allclose(found.means, positions_of(some.y, some.T_world_body))
    D = radial_shift(CAMERA, some.y)
    for i, y in enumerate(some.y):

        def position(error, i=i, y=y):
            moved = y + error[SMALL:] + error[SMALL - 1] * D[i]
            return positions_of(moved[None], some.T_world_body @ se3.exp(error[:6]))[0]

        J = difference(position, np.zeros(SMALL + 3), 1e-6)
        assert_allclose(found.J_vehicle[i], J[:, :SMALL], rtol=1e-5, atol=1e-6)
        assert_allclose(found.J_landmark[i], J[:, SMALL:], rtol=1e-5, atol=1e-6)
        rows = np.concatenate([np.arange(SMALL), SMALL + 3 * i + np.arange(3)])
        expected = J @ P[np.ix_(rows, rows)] @ J.T
        assert_allclose(found.covariances[i], expected, rtol=1e-4)


def test_a_disparity_within_two_deviations_of_zero_gives_no_position():
    y = np.array([[500.0, 495.9, 100.0], [500.0, 496.1, 100.0], [500.0, 510.0, 100.0]])
    own = np.tile(np.diag([2.0, 2.0, 1.0]), (3, 1, 1))
    assert has_position(y, own).tolist() == [True, False, False]


def test_the_map_keeps_what_it_was_given_in_its_order_whenever_it_is_asked():
    asked_often, asked_once = ImagePointMap(CAMERA), ImagePointMap(CAMERA)
    for seed in range(3):
        keys = np.arange(4 * seed, 4 * seed + 4)
        some, _ = points(seed)
        asked_often.add(keys, some)
        asked_once.add(keys, some)
        assert len(asked_often.all()[0]) == asked_often.count == 4 * seed + 4
        assert asked_once.count == 4 * seed + 4
    for often, once in zip(asked_often.all(), asked_once.all(), strict=True):
        assert_array_equal(often, once)
    assert asked_once.all()[0].tolist() == list(range(12))


def test_an_empty_map_has_no_landmarks():
    keys, means, covariances = ImagePointMap(CAMERA).all()
    assert (keys.shape, means.shape, covariances.shape) == ((0,), (0, 3), (0, 3, 3))
