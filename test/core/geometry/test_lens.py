# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA
from numpy.testing import assert_allclose

from vislam_ros.core.geometry.lens import radial_shift


def test_the_shift_is_that_of_the_first_radial_coefficient() -> None:
    y = np.array([[CAMERA.cx + 0.5 * CAMERA.fx, CAMERA.cx + 0.5 * CAMERA.fx, CAMERA.cy]])
    assert_allclose(radial_shift(CAMERA, y), [[0.125 * CAMERA.fx, 0.125 * CAMERA.fx, 0]])


def test_the_row_takes_the_mean_of_both_images_shifts() -> None:
    x_left, x_right, row = 0.4, 0.1, -0.2
    y = np.array([[x_left, x_right, row]]) * [CAMERA.fx, CAMERA.fx, CAMERA.fy]
    D = radial_shift(CAMERA, y + np.array([CAMERA.cx, CAMERA.cx, CAMERA.cy]))
    r2_left, r2_right = x_left**2 + row**2, x_right**2 + row**2
    expected = [x_left * r2_left, x_right * r2_right, row * (r2_left + r2_right) / 2]
    assert_allclose(D, [expected * np.array([CAMERA.fx, CAMERA.fx, CAMERA.fy])])
