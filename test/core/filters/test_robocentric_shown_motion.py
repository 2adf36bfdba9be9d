# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions that a frame shows: the first one, of which nothing was known, and past a wrong twist.

Image points of what is near move by more than in proportion to the way, so a motion that is
linearized about none comes out wrong: by twenty times what the covariance says, with tracks as
good as these.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import STANDING, frame_of

from vislam_ros.core.filters.robocentric import RobocentricFilter
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.motion import Increment, Part
from vislam_ros.data.simulation.simulate import BASELINE, INTRINSICS, T_BODY_CAMERA

Array = NDArray[np.float64]

CAMERA = StereoCamera.from_matrices(INTRINSICS, BASELINE, T_BODY_CAMERA)
SECONDS, PIXEL_STD, TURN_STD = 0.1, 0.2, 0.01
TWIST = np.array([9.0, 0.5, -0.3, 0.05, -0.1, 0.3])
POINTS = 60
SETTINGS = RobocentricSettings(
    pixel_variance=(PIXEL_STD**2,) * 4,
    angular_velocity_noise_std=TURN_STD,
    disparity_offset_std=0.0,
    gyro_bias_std=0.0,
    learn_noise=False,
)


def by_gyroscope(rng: np.random.Generator) -> Increment:
    """A step of which a gyroscope alone tells."""
    turn = TWIST[3:] + TURN_STD * rng.standard_normal(3)
    measured = np.concatenate([np.full(3, np.nan), turn])
    return Increment(np.eye(4), SECONDS, np.zeros((6, 6)), (Part(SECONDS, measured),))


def scene(rng: np.random.Generator) -> Array:
    """Points (n, 3) of the world, 8 to 40 m ahead of where the body begins."""
    ahead = rng.uniform(8.0, 40.0, POINTS)
    return np.column_stack([ahead, *(ahead * rng.uniform(-w, w, POINTS) for w in (0.4, 0.1))])


def seen(points: Array, steps: int, rng: np.random.Generator) -> Array:
    """Pixels (n, 4) of points after so many steps."""
    T = se3.inverse(se3.exp(steps * SECONDS * TWIST) @ CAMERA.T_body_camera)
    y = CAMERA.project(points @ T[:3, :3].T + T[:3, 3])
    return y[:, [0, 2, 1, 2]] + PIXEL_STD * rng.standard_normal((POINTS, 4))


def nees_after(steps: int, blind: int, seed: int) -> float:
    """NEES/6 of the pose after steps of which so many in the middle have no frame."""
    rng = np.random.default_rng(seed)
    points, keys = scene(rng), np.arange(POINTS)
    filter_ = RobocentricFilter(SETTINGS, CAMERA)
    filter_.step(STANDING, frame_of(keys, seen(points, 0, rng)))
    for k in range(1, steps):
        is_blind = steps - blind - 1 <= k < steps - 1
        frame = (keys[:0], np.empty((0, 4))) if is_blind else (keys, seen(points, k, rng))
        filter_.step(by_gyroscope(rng), frame_of(*frame))
    error = se3.log(se3.inverse(filter_.T_world_body) @ se3.exp((steps - 1) * SECONDS * TWIST))
    return float(error @ np.linalg.solve(filter_.pose_covariance, error)) / 6


@pytest.mark.parametrize(
    ("steps", "blind"), [(2, 0), (3, 0), (7, 4)], ids=["first", "second", "after a hole"]
)
def test_a_body_that_moves_already_is_where_the_filter_says(steps: int, blind: int) -> None:
    mean = np.mean([nees_after(steps, blind, seed) for seed in range(30)])
    # Cautious where the twist is in doubt.
    assert 0.3 < mean < 1.4


SLOW = np.array([1.5, 0.1, -0.1, 0.02, -0.03, 0.1])
STEPS, STRIKES_AT = 20, 10
TWIST_STD = np.repeat([0.05, 0.005], 3)
MEASURING = dataclasses.replace(
    SETTINGS, velocity_noise_std=0.05, angular_velocity_noise_std=0.005, chi2_gate=16.27
)


def error_of(
    seed: int, moves: Callable[[int], Array], measures: Callable[[int, Array], Array]
) -> tuple[float, float]:
    """Position error (m) and NEES/6 of a body that moves so, by a twist that is measured so."""
    rng = np.random.default_rng(seed)
    points, keys, T = scene(rng), np.arange(POINTS), np.eye(4)
    filter_ = RobocentricFilter(MEASURING, CAMERA)
    for k in range(STEPS):
        increment = STANDING
        if k:
            T = T @ se3.exp(SECONDS * moves(k))
            measured = measures(k, moves(k) + TWIST_STD * rng.standard_normal(6))
            part = Part(SECONDS, measured)
            increment = Increment(np.eye(4), SECONDS, np.zeros((6, 6)), (part,))
        C = se3.inverse(T @ CAMERA.T_body_camera)
        y = CAMERA.project(points @ C[:3, :3].T + C[:3, 3])
        pixels = y[:, [0, 2, 1, 2]] + PIXEL_STD * rng.standard_normal((POINTS, 4))
        filter_.step(increment, frame_of(keys, pixels))
    error = se3.log(se3.inverse(filter_.T_world_body) @ T)
    nees = float(error @ np.linalg.solve(filter_.pose_covariance, error)) / 6
    return float(np.linalg.norm(error[:3])), nees


def steadily(_: int) -> Array:
    return SLOW


def as_it_is(_: int, twist: Array) -> Array:
    return twist


def wrong_once(k: int, twist: Array) -> Array:
    return twist + np.array([20.0, 0, 0, 0, 0, 0]) if k == STRIKES_AT else twist


def turning_once(k: int, twist: Array) -> Array:
    return twist + np.array([0, 0, 0, 0, 0, 2.0]) if k == STRIKES_AT else twist


def silent_from_then_on(k: int, twist: Array) -> Array:
    return np.zeros(6) if k >= STRIKES_AT else twist


@pytest.mark.parametrize("measures", [wrong_once, turning_once, silent_from_then_on])
def test_a_twist_that_images_belie_costs_nothing(
    measures: Callable[[int, Array], Array],
) -> None:
    usual = np.mean([error_of(seed, steadily, as_it_is) for seed in range(15)], axis=0)
    error, nees = np.mean([error_of(seed, steadily, measures) for seed in range(15)], axis=0)
    assert error < 1.2 * usual[0] + 0.002
    assert nees < 1.3


def test_a_body_that_is_struck_is_followed_as_its_twist_and_images_tell() -> None:
    """The twist changes by sixty deviations of its walk, and nothing is wrong with it."""

    def struck(k: int) -> Array:
        return SLOW if k < STRIKES_AT else SLOW + np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.3])

    error, nees = np.mean([error_of(seed, struck, as_it_is) for seed in range(15)], axis=0)
    assert error < 0.01
    assert nees < 1.3
