# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pixels of two cameras that stand anyhow become those of the rectified pair, exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, pixels_of
from vislam_ros.core.geometry.pixel_rectification import (
    ImageTurn,
    Intrinsics,
    NoStereoPairError,
    PixelRectification,
    rectified_pair,
)

LEFT = Intrinsics(400.0, 390.0, 320.0, 240.0)
RIGHT = Intrinsics(405.0, 396.0, 310.0, 250.0)
ASIDE = se3.pose_matrix([0.1, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])


def seen(camera, points):
    """Pixels (n, 2) of points (n, 3) in a pinhole camera's axes."""
    x, y = (points[:, :2] / points[:, 2:]).T
    return np.column_stack([camera.fx * x + camera.cx, camera.fy * y + camera.cy])


def scene(seed=0, count=50):
    rng = np.random.default_rng(seed)
    return rng.uniform([-2, -2, 3], [2, 2, 20], (count, 3))


def turned(degrees, axis=1):
    """Pair with a right camera that is turned about one of its axes."""
    theta = np.zeros(6)
    theta[3 + axis] = np.radians(degrees)
    return ASIDE @ se3.exp(theta)


@given(
    rho=st.tuples(st.floats(0.05, 1.0), st.floats(-0.04, 0.04), st.floats(-0.04, 0.04)),
    theta=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    seed=st.integers(0, 99),
)
def test_any_pair_sees_what_the_rectified_camera_projects(rho, theta, seed):
    T_left_right = np.eye(4)
    T_left_right[:3, :3] = se3.exp_rotation(theta)
    T_left_right[:3, 3] = rho
    points = scene(seed)
    in_right = (points - T_left_right[:3, 3]) @ T_left_right[:3, :3]
    pixels = np.column_stack([seen(LEFT, points), seen(RIGHT, in_right)])

    pair = rectified_pair(LEFT, RIGHT, T_left_right)
    assert pair.pixels is not None
    R = np.eye(3) if pair.R_left_rectified is None else pair.R_left_rectified
    K = np.array([[LEFT.fx, 0, LEFT.cx], [0, LEFT.fy, LEFT.cy], [0, 0, 1]])
    camera = StereoCamera.from_matrices(K, pair.baseline, np.eye(4))
    # Angles that move no pixel by a thousandth are taken for roundings.
    np.testing.assert_allclose(
        pair.pixels.pixels(pixels), pixels_of(camera.project(points @ R)), atol=5e-3
    )


def test_other_intrinsics_alone_leave_the_left_pixels_bit_for_bit():
    pixels = np.random.default_rng(1).uniform(0, 640, (30, 4))
    pair = rectified_pair(LEFT, RIGHT, ASIDE)
    assert (pair.baseline, pair.R_left_rectified, pair.turns) == (0.1, None, False)
    result = pair.pixels.pixels(pixels)
    np.testing.assert_array_equal(result[:, :2], pixels[:, :2])
    np.testing.assert_allclose(
        result[:, 2], (pixels[:, 2] - RIGHT.cx) * (LEFT.fx / RIGHT.fx) + LEFT.cx, rtol=1e-14
    )


def test_the_left_camera_keeps_its_axes_where_the_baseline_is_its_x_axis():
    pair = rectified_pair(LEFT, LEFT, turned(5.0))
    assert pair.turns
    assert pair.R_left_rectified is None
    assert pair.pixels.left is None


@pytest.mark.parametrize(
    ("T_left_right", "moved"),
    [
        (ASIDE, False),
        (turned(np.degrees(0.9e-3 / LEFT.fx)), False),
        (turned(np.degrees(1.1e-3 / LEFT.fx)), True),
        (se3.pose_matrix([0.1, 0.9e-4 / LEFT.fx, 0.0], [0.0, 0, 0, 1]), False),
        (se3.pose_matrix([0.1, 1.1e-4 / LEFT.fx, 0.0], [0.0, 0, 0, 1]), True),
    ],
)
def test_a_pair_that_is_rectified_but_for_a_rounding_is_left_alone(T_left_right, moved):
    assert (rectified_pair(LEFT, LEFT, T_left_right).pixels is not None) is moved


@pytest.mark.parametrize(("difference", "moved"), [(0.9e-3, False), (1.1e-3, True)])
def test_intrinsics_that_differ_by_a_rounding_are_the_same(difference, moved):
    pair = rectified_pair(LEFT, LEFT._replace(cy=LEFT.cy + difference), ASIDE)
    assert (pair.pixels is not None) is moved


def direction(degrees):
    angle = np.radians(degrees)
    return se3.pose_matrix([np.cos(angle), np.sin(angle), 0.0], [0.0, 0, 0, 1])


@pytest.mark.parametrize(
    ("T_left_right", "is_pair"),
    [
        (direction(44.9), True),
        (direction(45.1), False),
        (direction(180.0), False),
        (np.eye(4), False),
        (turned(44.9), True),
        (turned(45.1), False),
        (turned(180.0, axis=2), True),  # mounted upside down
        (turned(180.0, axis=1), False),
    ],
)
def test_only_cameras_side_by_side_are_a_pair(T_left_right, is_pair):
    if is_pair:
        assert rectified_pair(LEFT, LEFT, T_left_right).baseline > 0
    else:
        with pytest.raises(NoStereoPairError, match="the right camera lies at"):
            rectified_pair(LEFT, LEFT, T_left_right)


def test_bits_do_not_depend_on_how_many_pixels_there_are():
    pixels = np.random.default_rng(2).uniform(0, 640, (101, 4)).astype(np.float32)
    rectification = rectified_pair(LEFT, RIGHT, turned(3.0) @ direction(2.0)).pixels
    together = rectification.pixels(pixels)
    one_by_one = np.concatenate([rectification.pixels(row[None]) for row in pixels])
    assert together.tobytes() == one_by_one.tobytes()


def test_what_no_camera_could_have_seen_is_left_out_of_a_frame():
    quarter_turn = (0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0)
    rectification = PixelRectification(None, ImageTurn(LEFT, LEFT, quarter_turn))
    left = [300.0, 200.0]
    # To the left of the axis is ahead after the turn, on it at a right angle, to its right behind.
    pixels = np.array(
        [[*left, 300.0, 240.0], [*left, 320.0, 240.0], [*left, 340.0, 240.0], [*left, 280, 240]],
        dtype=np.float32,
    )
    noise = np.array([0.1, 0.2, 0.3, 0.4], dtype=np.float32)
    ids, kept, stated = rectification.frame(np.arange(4, dtype=np.uint32), pixels, noise)
    assert ids.tolist() == [0, 3]
    assert stated is not None
    np.testing.assert_array_equal(stated, noise[[0, 3]])
    assert rectification.frame(ids, kept)[2] is None
    assert kept.dtype == np.float32
    np.testing.assert_allclose(kept[:, 2], LEFT.cx + LEFT.fx * LEFT.fx / np.array([20.0, 40.0]))
