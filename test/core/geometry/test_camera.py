# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA, difference
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, image_points_of, pixels_of

Array = NDArray[np.float64]


@pytest.fixture
def points() -> Array:
    rng = np.random.default_rng(4)
    return rng.uniform([-10, -3, 3], [10, 3, 60], (20, 3))


def test_projection_is_the_reports_calibration_matrix_times_pi(points: Array) -> None:
    homogeneous = np.column_stack([points, np.ones(len(points))])
    M = np.array(
        [
            [CAMERA.fx, 0, CAMERA.cx, 0],
            [0, CAMERA.fy, CAMERA.cy, 0],
            [CAMERA.fx, 0, CAMERA.cx, -CAMERA.fx_baseline],
            [0, CAMERA.fy, CAMERA.cy, 0],
        ]
    )
    expected = homogeneous @ M.T / points[:, 2:]
    y = CAMERA.project(points)
    assert_allclose(y, expected[:, [0, 2, 1]], rtol=1e-13)


def test_pixels_of_an_image_point_tell_it_again(points: Array) -> None:
    y = CAMERA.project(points)
    assert_allclose(image_points_of(pixels_of(y)), y, rtol=1e-15)


def test_an_image_point_lies_between_the_rows_of_both_images() -> None:
    pixels = np.array([[40.0, 10.0, 30.0, 11.0]], np.float32)
    assert image_points_of(pixels).tolist() == [[40.0, 30.0, 10.5]]


def test_triangulation_undoes_projection(points: Array) -> None:
    assert_allclose(CAMERA.triangulate(CAMERA.project(points)), points, rtol=1e-11)


def test_projection_jacobian_is_its_finite_difference(points: Array) -> None:
    for point, J in zip(points, CAMERA.project_jacobian(points), strict=True):
        assert_allclose(J, difference(CAMERA.project, point), rtol=1e-6, atol=1e-5)


def test_triangulation_jacobian_is_its_finite_difference(points: Array) -> None:
    image_points = CAMERA.project(points)
    for y, J in zip(image_points, CAMERA.triangulate_jacobian(image_points), strict=True):
        assert_allclose(J, difference(CAMERA.triangulate, y, 1e-5), rtol=1e-5, atol=1e-6)


def test_warp_is_triangulate_move_project(points: Array) -> None:
    T = se3.exp([0.1, -0.2, 0.3, 0.02, -0.01, 0.03])
    moved = points @ T[:3, :3].T + T[:3, 3]
    assert_allclose(CAMERA.warp(CAMERA.project(points), T), CAMERA.project(moved), rtol=1e-10)


def test_warp_passes_smoothly_through_zero_disparity() -> None:
    T = se3.exp([0.1, -0.2, 1.0, 0.02, -0.01, 0.03])
    y = np.array([[650.0, 650.0 - d, 200.0] for d in (-1e-6, 0.0, 1e-6)])
    before, at, after = CAMERA.warp(y, T)
    assert np.all(np.isfinite(at))
    assert_allclose(0.5 * (before + after), at, atol=1e-8)


def test_an_inexact_rotation_is_made_orthonormal() -> None:
    T = np.array(CAMERA.T_body_camera)
    T[:3, :3] += 1e-8
    camera = StereoCamera.from_matrices(np.diag([700.0, 700, 1]), 0.5, T)
    R = camera.T_body_camera[:3, :3]
    assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert camera.baseline == pytest.approx(0.5)
