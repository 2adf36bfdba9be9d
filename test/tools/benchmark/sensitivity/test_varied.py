# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from benchmark.sensitivity.constants import CONSTANTS, Constant, scaled
from benchmark.sensitivity.varied import varied
from numerics import CAMERA
from numpy.testing import assert_array_equal

from vislam_ros.core import motion
from vislam_ros.core.filters import robocentric, robocentric_model
from vislam_ros.core.geometry import warp
from vislam_ros.core.noise import motion_noise, track_noise
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.track_noise import TrackNoise


def named(key: str) -> Constant:
    return next(constant for constant in CONSTANTS if constant.key == key)


def test_every_constant_stands_where_it_is_said_to_and_has_other_values_to_try() -> None:
    for constant in CONSTANTS:
        assert len(constant.values) == 2
        assert constant.value not in constant.values
    assert len({constant.key for constant in CONSTANTS}) == len(CONSTANTS)


def test_numbers_are_halved_and_doubled_in_their_own_kind() -> None:
    assert scaled(0.3, 0.5) == 0.15
    assert scaled(5, 0.5) == 2
    assert scaled(1, 0.5) == 1
    assert scaled((3.0, 4.0), 2.0) == (6.0, 8.0)


def test_a_constant_has_its_other_value_while_the_context_lasts() -> None:
    constant = named("core.motion.FIRST_TWIST_STD")
    before = motion.FIRST_TWIST_STD
    with varied(constant, (1.0,) * 6):
        assert_array_equal(motion.FIRST_TWIST_STD, np.ones(6))
        # Wherever it was imported, too.
        assert vars(robocentric_model)["FIRST_TWIST_STD"] is motion.FIRST_TWIST_STD
    assert vars(robocentric_model)["FIRST_TWIST_STD"] is motion.FIRST_TWIST_STD is before


def test_a_constant_of_another_module_with_the_same_name_and_value_is_left_alone() -> None:
    with varied(named("core.noise.motion_noise._MEMORY"), 1.0):
        assert motion_noise._MEMORY == 1.0
        assert track_noise._MEMORY == 30.0


def ahead(y: np.ndarray) -> list[bool]:
    return warp.warp(CAMERA, y, np.eye(4)).ahead.tolist()


def test_compiled_functions_and_those_that_call_them_use_the_other_value() -> None:
    # At 14 and at 45 degrees.
    y = np.array([[CAMERA.cx + f * CAMERA.fx, CAMERA.cx, CAMERA.cy] for f in (0.25, 1.0)])
    y[:, 1] = y[:, 0] - 5.0
    assert ahead(y) == [True, True]
    with varied(named("core.geometry.warp._MAX_RAY_SQUARED"), 0.5):
        assert ahead(y) == [True, False]
    assert ahead(y) == [True, True]


def test_modules_that_have_imported_a_compiled_function_use_the_other_value() -> None:
    y, own = np.array([[503.0, 500.0, 100.0]]), np.eye(3)[None]
    assert vars(robocentric)["has_position"](y, own)
    with varied(named("core.filters.image_point_map._SIGNIFICANT_DISPARITY"), 3.0):
        assert not vars(robocentric)["has_position"](y, own)
    assert vars(robocentric)["has_position"](y, own)


def test_two_values_of_one_constant_do_not_mix() -> None:
    noise = TrackNoise(np.ones(3), 0.0, FrameRate(), learns=True)
    noise.add(1)
    first, far = np.array([0]), np.array([8.0, 0.0, 0.0])

    def variance() -> float:
        return noise.with_tails(first, np.ones((1, 3)), np.eye(3), far)[0, 0].item()

    as_is, found = variance(), []
    for numbers in (3.0, 5.0, 3.0):
        with varied(named("core.noise.track_noise._PRIOR_NUMBERS"), numbers):
            found.append(variance())
    # The prior's numbers of one, and 8 squared, by all numbers there are.
    assert found == pytest.approx([67 / 6, 69 / 8, 67 / 6])
    assert variance() == as_is == pytest.approx(70 / 9)
