# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Sequence

import numpy as np
from frontend.rendered_world import Shot
from scipy.spatial.distance import cdist

from vislam_ros.frontend.detection import new_corners

NONE = np.empty((0, 2), np.float32)


def test_corners_are_spread_over_the_image(walk: Sequence[Shot]) -> None:
    corners = new_corners(walk[0].left, NONE, 60, 60)
    assert corners.shape == (60, 2)
    assert corners.dtype == np.float32
    columns, rows = (corners // [376 / 4, 240 / 3]).astype(int).T
    assert np.bincount(rows * 4 + columns, minlength=12).min() >= 2
    apart = cdist(corners, corners) + 1e3 * np.eye(60)
    assert apart.min() > np.sqrt(376 * 240 / 60) / 3


def test_corners_keep_away_from_the_points_there_are(walk: Sequence[Shot]) -> None:
    there = new_corners(walk[0].left, NONE, 40, 80)
    new = new_corners(walk[0].left, there, 40, 80)
    assert len(new) > 20
    assert cdist(new, there).min() > np.sqrt(376 * 240 / 80) / 3


def test_shadows_have_corners_too(walk: Sequence[Shot]) -> None:
    image = walk[0].left.copy()
    image[:, :188] //= 6
    corners = new_corners(image, NONE, 60, 60)
    assert np.mean(corners[:, 0] < 180) > 0.3


def test_a_flat_or_tiny_image_has_no_corners(walk: Sequence[Shot]) -> None:
    assert not len(new_corners(np.full((240, 376), 90, np.uint8), NONE, 60, 60))
    assert not len(new_corners(np.ascontiguousarray(walk[0].left[:9, :9]), NONE, 60, 60))
    assert not len(new_corners(walk[0].left, NONE, 0, 60))
