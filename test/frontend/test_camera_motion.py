# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.frontend.camera_motion import camera_motion, moved

Array = NDArray[np.float64]
MOTIONS = {
    "stands": np.zeros(6),
    "turns": np.array([0, 0, 0, 0.01, 0.05, -0.02]),
    "drives": np.array([0.02, 0.01, -0.9, 0.001, 0.01, 0.0]),
}


def seen(seed: int = 0, count: int = 60) -> Array:
    """Image points (n, 3) of what lies before the camera, a few of them at infinity."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-10, -3, 5], [10, 3, 60], (count, 3))
    y = CAMERA.project(points)
    y[:5, 1] = y[:5, 0]
    return y


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_is_found_beside_a_third_of_wrong_tracks(name: str) -> None:
    T = se3.exp(MOTIONS[name])
    y = seen()
    rng = np.random.default_rng(1)
    now = CAMERA.warp(y, T)[:, [0, 2]] + rng.normal(0, 0.1, (60, 2))
    now[20:40] += rng.uniform(5, 30, (20, 2))
    found = camera_motion(CAMERA, y, now.astype(np.float32), 1.5)
    assert found is not None
    off = se3.log(se3.inverse(T) @ found)
    assert np.abs(off[:3]).max() < 0.05
    assert np.abs(off[3:]).max() < 2e-3


def test_where_the_points_do_not_agree_there_is_no_motion() -> None:
    y = seen()
    now = np.random.default_rng(2).uniform(0, 400, (60, 2)).astype(np.float32)
    assert camera_motion(CAMERA, y, now, 1.5) is None


@pytest.mark.parametrize(("count", "is_found"), [(7, False), (8, True)])
def test_a_motion_takes_eight_points(count: int, is_found: bool) -> None:
    y = seen()[10 : 10 + count]
    found = camera_motion(CAMERA, y, y[:, [0, 2]].astype(np.float32), 1.5)
    assert (found is not None) == is_found


def test_maps_are_finite_differences_over_a_tilted_surface() -> None:
    T = se3.exp(np.array([0.1, -0.05, -0.8, 0.02, 0.03, 0.1]))
    y = seen(3)[5:]
    slopes = np.random.default_rng(4).uniform(-0.2, 0.2, (len(y), 2)).astype(np.float32)
    warped, maps, ahead = moved(CAMERA, y, slopes, T)
    assert ahead.all()
    assert_allclose(warped, CAMERA.warp(y, T), rtol=1e-9)
    for axis, step in enumerate(([1.0, 0.0], [0.0, 1.0])):
        along = np.empty_like(y)
        along[:, 0] = step[0]
        along[:, 1] = step[0] + slopes @ step
        along[:, 2] = step[1]
        change = (CAMERA.warp(y + 1e-4 * along, T) - CAMERA.warp(y - 1e-4 * along, T)) / 2e-4
        assert_allclose(maps[..., axis], change[:, [0, 2]], rtol=1e-5, atol=1e-7)


def test_what_has_passed_the_camera_is_not_ahead() -> None:
    y = CAMERA.project([[0.5, 0.2, 2.0], [0.5, 0.2, 20.0]])
    _, maps, ahead = moved(CAMERA, y, np.zeros((2, 2), np.float32), se3.exp([0, 0, -3, 0, 0, 0]))
    assert ahead.tolist() == [False, True]
    assert np.isfinite(maps).all()
