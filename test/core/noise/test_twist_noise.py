# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.twist_noise import TwistNoise, white_noise_levels, white_noise_std

Array = NDArray[np.float64]

PRIOR = np.repeat([0.5, 0.05], 3)


def estimated(samples: Array, prior: Array = PRIOR) -> Array:
    noise = TwistNoise(prior, FrameRate())
    for sample in samples:
        noise.add(sample)
    return noise.std


def white(level: float, count: int, seed: int = 41) -> Array:
    """Twists (count, 6) of noise alone, the angular velocities' a tenth of the velocities'."""
    rng = np.random.default_rng(seed)
    return level * np.repeat([1.0, 0.1], 3) * rng.standard_normal((count, 6))


def smooth_motion(count: int) -> Array:
    """Twists (count, 6) at 10 Hz of a vehicle that brakes, weaves and turns."""
    t = 0.1 * np.arange(count)
    periods = np.array([23.0, 5.0, 4.0, 6.0, 5.0, 8.0])
    sizes = np.array([4.0, 0.2, 0.2, 0.02, 0.02, 0.5])
    return sizes * np.sin(2 * np.pi * t[:, None] / periods + np.arange(6))


@pytest.mark.parametrize("level", [0.02, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("seed", [41, 42])
def test_white_noise_of_any_level_is_found_on_average_of_the_axes(level: float, seed: int) -> None:
    ratio = estimated(white(level, 300, seed)) / (level * np.repeat([1.0, 0.1], 3))
    assert_allclose(ratio.mean(), 1.0, atol=0.1)
    assert_allclose(ratio, 1.0, atol=0.3)


def test_a_smooth_motion_on_top_does_not_matter() -> None:
    noise = white(0.1, 300)
    assert_allclose(estimated(smooth_motion(300) + noise), estimated(noise), rtol=0.1)


def test_a_constant_on_top_matters_not_at_all() -> None:
    noise = white(0.1, 300)
    assert_allclose(estimated(noise + 7.0), estimated(noise), rtol=1e-9)


def test_a_jerk_now_and_then_does_not_matter() -> None:
    samples = white(0.1, 300)
    jerking = samples.copy()
    jerking[10::40] += 5.0
    assert_allclose(estimated(jerking), estimated(samples), rtol=0.25)


def test_a_motion_without_noise_has_next_to_none() -> None:
    assert np.all(estimated(smooth_motion(300)) < 0.02 * PRIOR)


def test_before_there_is_a_third_difference_it_is_the_prior() -> None:
    assert_allclose(estimated(white(0.1, 3)), PRIOR)


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_a_prior_that_is_a_hundredfold_off_fades_within_half_a_minute(factor: float) -> None:
    level = np.repeat([0.1, 0.01], 3)
    samples = white(0.1, 300)
    assert_allclose(estimated(samples, factor * level).mean(), level.mean(), rtol=0.35)
    errors = [
        np.abs(np.log(estimated(samples[:count], factor * level) / level)).mean()
        for count in (3, 30, 300)
    ]
    assert errors == sorted(errors, reverse=True)


def test_it_follows_a_noise_that_changes() -> None:
    samples = np.concatenate([white(0.5, 400), white(0.05, 400)])
    assert_allclose(estimated(samples), estimated(white(0.05, 400)), rtol=0.05)


def test_every_estimate_is_finite_and_of_standing_samples_small() -> None:
    noise = TwistNoise(PRIOR, FrameRate())
    for _ in range(400):
        noise.add(np.zeros(6))
        assert np.all(np.isfinite(noise.std))
        assert np.all(noise.std >= 0)
    assert np.all(noise.std < 0.01 * PRIOR)


def test_half_a_minute_is_remembered_at_any_rate(rate: FrameRate) -> None:
    noise, memory = TwistNoise(PRIOR, rate), 30 * rate.hertz
    louder, quiet = white(0.5, 2 * memory), white(0.05, memory + 10)
    for sample in louder:
        noise.add(sample)
    for sample in quiet[: 2 * memory // 5]:
        noise.add(sample)
    # Most of the last half minute was louder.
    assert np.all(noise.std > 2 * np.repeat([0.05, 0.005], 3))
    for sample in quiet[2 * memory // 5 :]:
        noise.add(sample)
    assert_allclose(noise.std, white_noise_std(np.abs(np.diff(quiet, 3, axis=0))), rtol=0.05)


@pytest.mark.parametrize(("differences", "median"), [([9.0, 1, 3], 3.0), ([9.0, 1, 3, 2], 2.5)])
def test_the_noise_is_the_median_of_third_differences_to_scale(
    differences: list[float], median: float
) -> None:
    std = white_noise_std(np.array(differences)[:, None])
    # A third difference has 20 times the variance, and half of a normal variable lies within
    # 0.6745 of its standard deviation.
    assert_allclose(std, median / 0.6745 / np.sqrt(20), rtol=1e-4)


@pytest.mark.parametrize(
    "axes", [[2, 0.2, 3, 0.5, 0.2, 0.3], [3, 2, 0.2, 2, 3, 4], [1, 2, 3, 0.1, 1, 1]]
)
def test_the_levels_of_twists_are_those_of_the_quietest_axes(axes: list[float]) -> None:
    noise = np.array(axes) * np.random.default_rng(42).standard_normal((4000, 6))
    levels = min(axes[:3]), min(axes[3:])
    assert_allclose(white_noise_levels(noise), levels, rtol=0.07)
    assert np.all(np.isfinite(white_noise_levels(noise[:4])))
    assert white_noise_levels(noise[:3]) == (np.inf, np.inf)


def test_the_prior_counts_as_ten_samples_and_fades_once_there_are_five() -> None:
    noise = TwistNoise(PRIOR, FrameRate())
    weights = {1: 10.0, 2: 10.0, 5: 10.0, 10: 10 / 4, 20: 10 / 16, 40: 10 / 64}
    for differences in range(-2, 41):
        noise.add(np.zeros(6))
        if differences in weights:
            weight = weights[differences]
            assert_allclose(noise.std**2, PRIOR**2 * weight / (weight + differences))


def test_the_median_is_taken_at_each_of_the_first_fifty_and_then_at_each_tenth_sample() -> None:
    noise, samples = TwistNoise(PRIOR, FrameRate()), white(0.1, 83)
    changes = []
    for differences, sample in enumerate(samples, start=-2):
        before = noise.std
        noise.add(sample)
        if noise.std is not before:
            changes.append(differences)
    assert changes == [*range(1, 51), 60, 70, 80]
