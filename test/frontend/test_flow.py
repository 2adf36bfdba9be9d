# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Sequence

import numpy as np
from frontend.rendered_world import Shot
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.frontend.detection import new_corners
from vislam_ros.frontend.flow import alike, follow

NONE = np.empty((0, 2), np.float32)


def test_points_are_followed_over_a_long_way_with_a_guess(walk: Sequence[Shot]) -> None:
    image = walk[0].left
    moved = np.roll(image, 90, axis=1)
    points = new_corners(image, NONE, 60, 60)
    points = points[points[:, 0] < 270]
    there, found = follow(image, moved, points, points + np.array([80, 0], np.float32), 1.0)
    assert found.mean() > 0.9
    assert_allclose(there[found], points[found] + [90, 0], atol=0.1)
    _, without = follow(image, moved, points, points, 1.0)
    assert without.mean() < 0.5


def test_what_leaves_the_image_or_is_covered_is_not_found(walk: Sequence[Shot]) -> None:
    image = walk[0].left
    covered = np.roll(image, 8, axis=1)
    covered[:, 150:250] = np.random.default_rng(0).integers(0, 255, (240, 100))
    points = new_corners(image, NONE, 60, 60)
    _, found = follow(image, covered, points, points, 1.0)
    under = (points[:, 0] > 157) & (points[:, 0] < 227)
    gone = points[:, 0] > 370
    assert found[under | gone].mean() < 0.15
    assert found[~under].mean() > 0.6


def test_no_points_are_no_trouble(walk: Sequence[Shot]) -> None:
    there, found = follow(walk[0].left, walk[1].left, NONE, NONE, 1.0)
    assert there.shape == (0, 2)
    assert found.shape == (0,)


def test_an_image_is_given_the_light_of_another(walk: Sequence[Shot]) -> None:
    image = walk[0].left
    other = (image * 0.5 + 60).astype(np.uint8)
    changed = alike(image, other).astype(float)
    assert abs(changed.mean() - other.mean()) < 0.5
    assert abs(changed.std() - other.std()) < 0.5
    flat = np.full_like(image, 7)
    assert_array_equal(alike(flat, image), flat)
    assert_array_equal(alike(image, flat), image)
