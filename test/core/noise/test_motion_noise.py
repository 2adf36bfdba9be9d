# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.motion_noise import MotionNoise

Array = NDArray[np.float64]

TWIST = np.repeat([0.5, 0.05], 3)
WALK = np.repeat([0.31, 0.05], 3)


def _learned_walk(walk: Array, vision: Array, steps: int, tau: float) -> Array:
    """Walk (6,) that is learned where vision sees the twist with a noise (6,) in each step."""
    rng = np.random.default_rng(41)
    noise = MotionNoise(TWIST, WALK, FrameRate())
    u, mean, variance = np.zeros(6), np.zeros(6), np.full(6, 100.0)
    for _ in range(steps):
        u = u + np.sqrt(tau) * walk * rng.standard_normal(6)
        before, variance_before = mean, variance + tau * noise.walk_variance
        gain = variance_before / (variance_before + vision**2)
        mean = mean + gain * (u + vision * rng.standard_normal(6) - mean)
        variance = (1 - gain) * variance_before
        noise.update(mean - before, variance_before, variance, np.zeros(6), np.ones(6), tau)
    return np.sqrt(noise.walk_variance)


@pytest.mark.parametrize("tau", [0.1, 0.05])
@pytest.mark.parametrize("ratio", [0.2, 1.0, 3.0])
def test_the_walk_of_each_axis_is_found_while_vision_sees_it(ratio: float, tau: float) -> None:
    walk = ratio * np.array([0.3, 0.2, 0.15, 0.05, 0.05, 0.03])
    learned = _learned_walk(walk, vision=0.3 * np.sqrt(tau) * walk, steps=1500, tau=tau)
    assert_allclose(learned, walk, rtol=0.2)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_a_walk_that_vision_hardly_sees_is_found_too(ratio: float) -> None:
    walk = ratio * WALK
    learned = _learned_walk(walk, vision=3.0 * np.sqrt(0.1) * walk, steps=3000, tau=0.1)
    assert_allclose(learned, walk, rtol=0.3)


@pytest.mark.parametrize("quiet", range(3))
def test_motion_that_jerks_on_other_axes_is_not_taken_for_noise(quiet: int) -> None:
    rng = np.random.default_rng(42)
    noise = MotionNoise(TWIST, WALK, FrameRate())
    jerks = np.tile(np.arange(3) != quiet, 2)
    for _ in range(400):
        twist = 0.01 * rng.standard_normal(6)
        noise.add(twist + jerks * rng.standard_normal(6))
    assert_allclose(np.sqrt(noise.twist_variance), 0.01, rtol=0.25)


def test_a_twist_that_never_changes_keeps_some_room() -> None:
    noise = MotionNoise(TWIST, np.zeros(6), FrameRate())
    for _ in range(2000):
        noise.update(
            np.zeros(6),
            0.1 * noise.walk_variance + 1e-12,
            np.zeros(6),
            np.zeros(6),
            np.ones(6),
            0.1,
        )
    assert_allclose(np.sqrt(noise.walk_variance), np.repeat([3e-3, 3e-4], 3))


def test_a_twist_without_any_noise_keeps_some() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    for _ in range(3000):
        noise.add(np.array([1.0, 0, 0, 0, 0, 0.1]))
        noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, np.zeros(6), np.zeros(6), 0.1)
    assert_allclose(np.sqrt(noise.twist_variance), np.repeat([1e-5, 1e-6], 3))


def test_what_vision_sees_of_the_measured_twists_noise_counts_where_it_is_less() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    rng = np.random.default_rng(43)
    jerks = np.repeat([0.4, 0.04], 3)
    for _ in range(400):
        noise.add(jerks * rng.standard_normal(6))
    for std, expected in ((0.1, 0.1), (10.0, 0.4)):
        for _ in range(3000):
            unexplained = np.repeat([std, 0.1 * std], 3) ** 2
            noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, np.zeros(6), unexplained, 0.1)
        levels = np.sqrt(noise.twist_variance)
        assert_allclose(levels, np.repeat([expected, 0.1 * expected], 3), rtol=0.15)


def test_what_vision_has_seen_fades_within_half_a_minute_at_any_rate(rate: FrameRate) -> None:
    noise, tau = MotionNoise(TWIST, WALK, rate), 1.0 / rate.hertz
    for seconds, std in ((600, 0.1), (30, 0.2)):
        squares = np.full(6, std**2)
        for _ in range(seconds * rate.hertz):
            # Vision sees all of the motion, so that the walk is the mean square of its changes.
            before = tau * noise.walk_variance
            change, error = np.sqrt(tau * squares), 0.1 * np.sqrt(squares)
            noise.update(change, before, np.zeros(6), error, np.zeros(6), tau)
    expected = 0.2**2 + (0.1**2 - 0.2**2) * np.exp(-1)
    assert_allclose(noise.walk_variance, expected, rtol=0.01)
    assert_allclose(noise.twist_variance, 0.01 * expected, rtol=0.01)


def test_the_prior_of_the_walk_counts_as_five_steps() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    for steps in (1, 2, 3):
        before = 0.1 * noise.walk_variance
        noise.update(np.sqrt(0.1) * 2 * WALK, before, np.zeros(6), np.zeros(6), np.ones(6), 0.1)
        assert_allclose(noise.walk_variance, (5 + 4 * steps) / (5 + steps) * WALK**2)


def test_a_walk_that_is_told_counts_as_five_steps_again() -> None:
    noise, told = MotionNoise(TWIST, WALK, FrameRate()), 3 * WALK
    for _ in range(50):
        Q = 0.1 * noise.walk_variance
        noise.update(np.sqrt(0.1) * WALK, Q, np.zeros(6), np.zeros(6), np.ones(6), 0.1)
    noise.tell(TWIST, told)
    Q = 0.1 * noise.walk_variance
    noise.update(np.sqrt(0.1) * 2 * told, Q, np.zeros(6), np.zeros(6), np.ones(6), 0.1)
    assert_allclose(noise.walk_variance, (5 + 4) / 6 * told**2)


def test_ten_steps_are_a_beginning() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    for _ in range(10):
        assert noise.begins
        noise.update(WALK, WALK**2, 0.5 * WALK**2, np.zeros(6), np.ones(6), 0.1)
    assert not noise.begins


def test_what_remains_uncertain_of_a_change_counts_with_what_is_seen_of_it() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    # Twice as much was unknown as the step has added, and half of that still is.
    Q = 0.1 * WALK**2
    noise.update(np.sqrt(Q), 2 * Q, Q, np.zeros(6), np.ones(6), 0.1)
    assert_allclose(noise.walk_variance, WALK**2 * (5 + (1 / 4 + 1 - 1 / 4)) / 6)


def test_vision_bounds_the_twists_noise_from_fifty_steps_on() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    for _ in range(50):
        assert_allclose(noise.twist_variance, TWIST**2)
        # The mean over a sensor's axes counts.
        squares = np.array([1, 2, 6, 2, 3, 4]) * 1e-4
        noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, np.sqrt(squares), np.zeros(6), 0.1)
    # Five steps that the prior counts as, and these.
    assert_allclose(noise.twist_variance, TWIST**2 + (3e-4 - TWIST**2) / (5 + 50))


@pytest.mark.parametrize("vision", [0.3, 1.0, 3.0])
def test_a_noise_of_the_twist_is_found_however_little_vision_sees_of_it(vision: float) -> None:
    """What vision leaves of the twist is so many times the noise that is looked for."""
    rng = np.random.default_rng(44)
    noise, true = MotionNoise(TWIST, WALK, FrameRate()), 0.1 * TWIST
    A = np.square(vision * true)
    for _ in range(4000):
        R = noise.twist_variance
        innovation = np.sqrt(A + true**2) * rng.standard_normal(6)
        error, variance = R / (A + R) * innovation, A * R / (A + R)
        noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, error, variance, 0.1)
    assert_allclose(np.sqrt(noise.twist_variance), true, rtol=0.2)


def test_a_slow_error_of_the_twist_is_its_noise_where_vision_contradicts_it() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    # A smooth velocity that points beside the motion in three steps of four, as others tell.
    slow = np.array([0.0, 0.3, 0.3, 0.0, 0.0, 0.0])
    for step in range(60):
        noise.add(np.full(6, 0.1 * step))
        error = slow if step % 4 else np.zeros(6)
        noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, error, np.full(6, 1e-6), 0.1)
    velocity, turn_rate = noise.twist_variance[0], noise.twist_variance[3]
    assert_allclose(velocity, 1.4826**2 * 2 * 0.09 / 3, rtol=1e-3)
    assert turn_rate < 1e-3


def test_a_few_wrong_steps_do_not_make_it_noise() -> None:
    noise = MotionNoise(TWIST, WALK, FrameRate())
    for step in range(60):
        noise.add(np.full(6, 0.1 * step))
        error = np.full(6, 0.0 if step % 4 else 3.0)
        noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, error, np.full(6, 1e-6), 0.1)
    white = noise.twist_variance
    assert np.all(white < 0.01)


def test_a_twist_that_images_belie_counts_as_three_deviations_off_however_far_it_is() -> None:
    variance = TWIST**2
    levels = []
    for error, is_used in ((3.0 * np.sqrt(2.0 * variance), True), (np.full(6, 1e3), False)):
        noise = MotionNoise(TWIST, WALK, FrameRate())
        for _ in range(60):
            noise.update(np.zeros(6), WALK**2, 0.5 * WALK**2, np.zeros(6), variance, 0.1)
        step = np.zeros(6), WALK**2, 0.5 * WALK**2, error, variance, 0.1
        noise.update(*step, is_used=is_used)
        levels.append(noise.twist_variance)
    assert_allclose(levels[0], levels[1], rtol=1e-9)
