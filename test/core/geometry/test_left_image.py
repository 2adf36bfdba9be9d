# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.left_image import left_warp
from vislam_ros.core.geometry.warp import warp


def test_it_is_the_compiled_warp_in_the_left_image() -> None:
    rng = np.random.default_rng(6)
    disparity = np.concatenate([rng.uniform(-1.0, 60.0, 180), np.full(20, 400.0)])
    u = rng.uniform(100, 1100, 200)
    y = np.column_stack([u, u - disparity, rng.uniform(50, 320, 200)])
    motions = se3.exp(rng.normal(0.0, (1.0, 0.1, 0.1, 0.02, 0.02, 0.1), (200, 6)))
    found, expected = left_warp(CAMERA, y, motions), warp(CAMERA, y, motions)
    ahead = expected.ahead
    assert_array_equal(found.ahead, ahead)
    assert 0 < ahead.sum() < len(ahead)
    assert_allclose(found.y[ahead], expected.y[ahead][:, [0, 2]], rtol=1e-11)
    assert_allclose(found.F_y[ahead], expected.F_y[ahead][:, [0, 2]], rtol=1e-9, atol=1e-9)
    assert_allclose(found.G[ahead], expected.G[ahead][:, [0, 2]], rtol=1e-9, atol=1e-7)
