# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA, difference
from numpy.testing import assert_allclose

from vislam_ros.core.lens import corrected, distorted, radial_shift

rng = np.random.default_rng(32)
POINTS = np.column_stack(
    [rng.uniform(0, 1240, 20), rng.uniform(0, 1240, 20), rng.uniform(0, 370, 20)]
)


def test_the_shift_is_that_of_the_first_radial_coefficient():
    y = np.array([[CAMERA.cx + 0.5 * CAMERA.fx, CAMERA.cx + 0.5 * CAMERA.fx, CAMERA.cy]])
    assert_allclose(radial_shift(CAMERA, y)[0], [[0.125 * CAMERA.fx, 0.125 * CAMERA.fx, 0]])


def test_the_shifts_derivative_is_its_finite_difference():
    for y, J in zip(POINTS, radial_shift(CAMERA, POINTS)[1], strict=True):
        numeric = difference(lambda p: radial_shift(CAMERA, p[None])[0][0], y, 1e-3)
        assert_allclose(J, numeric, atol=1e-6)


def test_distorting_undoes_correcting_in_value_and_derivative():
    c, by_y, _ = corrected(CAMERA, POINTS, -0.02)
    y, by_c, by_kappa = distorted(CAMERA, c, -0.02)
    assert_allclose(y, POINTS, atol=1e-9)
    assert_allclose(by_c @ by_y, np.broadcast_to(np.eye(3), by_y.shape), atol=1e-11)
    numeric = difference(lambda k: distorted(CAMERA, c, float(k[0]))[0], np.array([-0.02]), 1e-5)
    assert_allclose(by_kappa, numeric[..., 0], rtol=1e-4, atol=1e-3)


def test_without_distortion_nothing_moves():
    assert_allclose(corrected(CAMERA, POINTS, 0.0)[0], POINTS)
    assert_allclose(distorted(CAMERA, POINTS, 0.0)[0], POINTS)
