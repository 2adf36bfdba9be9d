# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.noise.disparity_prior import DisparityPrior


def scene(count, seed=61):
    """True disparities as on drive 03, and what is measured of them with a variance of 2."""
    rng = np.random.default_rng(seed)
    true = 7.0 * np.exp(0.75 * rng.standard_normal(count))
    return true, true + np.sqrt(2.0) * rng.standard_normal(count)


def learned(measured):
    prior = DisparityPrior()
    for part in np.array_split(measured, 40):
        prior.add(part)
    return prior


def test_the_posterior_is_nearer_to_the_truth_and_knows_how_near():
    prior = learned(scene(2000)[1])
    true, measured = scene(5000, seed=62)
    mean, variance = prior.posterior(measured, np.full(5000, 2.0))
    error = mean - true
    assert np.mean(error**2) < 0.9 * np.mean((measured - true) ** 2)
    assert 0.9 < np.mean(error**2 / variance) < 1.1
    # Near the median, where noise carries more points down than up, the bias is gone.
    middle = np.abs(measured - 7.0) < 1.0
    assert np.mean((measured - true)[middle]) > 0.2
    assert abs(np.mean(error[middle])) < 0.08


def test_a_disparity_far_above_the_noise_stays():
    prior = learned(scene(2000)[1])
    measured = np.array([60.0, 1e9])
    mean, variance = prior.posterior(measured, np.full(2, 2.0))
    assert_allclose(mean, measured, atol=0.3)
    assert_allclose(variance, 2.0, rtol=0.1)


def test_what_contradicts_the_prior_is_left_as_it_is():
    prior = learned(scene(2000)[1])
    measured, variance = np.array([-190.0, -8.0]), np.full(2, 2.0)
    for found, given in zip(
        prior.posterior(measured, variance), (measured, variance), strict=True
    ):
        assert_array_equal(found, given)


def test_there_is_no_prior_before_a_hundred_landmarks_nor_where_all_are_far():
    measured, variance = np.array([3.0, 0.0]), np.full(2, 2.0)
    few = learned(scene(90)[1])
    far = learned(np.random.default_rng(63).standard_normal(2000))
    for prior in (DisparityPrior(), few, far):
        assert_array_equal(prior.posterior(measured, variance)[0], measured)
    mean, remaining = few.posterior(np.empty(0), np.empty(0))
    assert mean.shape == remaining.shape == (0,)


def test_an_image_point_moves_along_with_its_disparity_and_its_covariance_says():
    prior = learned(scene(2000)[1])
    y = np.array([[500.0, 498.5, 100.0], [700.0, 693.0, 50.0]])
    noise = np.tile(np.diag([1.0, 3.0, 0.5]), (2, 1, 1))
    mean, remaining = prior.posterior(y[:, 0] - y[:, 1], np.full(2, 4.0))
    moved, left = prior.apply(y, noise)
    assert_allclose(moved[:, 0] - moved[:, 1], mean)
    assert_allclose(left[:, 0, 0] + left[:, 1, 1] - 2 * left[:, 0, 1], remaining)
    # The worse of the two columns moves three times as far, the row not at all.
    assert_allclose((moved - y)[:, 1], -3 * (moved - y)[:, 0])
    assert_array_equal(moved[:, 2], y[:, 2])
    assert np.all(np.linalg.eigvalsh(left) > 0)


def test_the_posterior_is_the_integral_over_the_prior():
    prior = learned(scene(2000)[1])
    low, middle, high = np.quantile(scene(2000)[1], [0.25, 0.5, 0.75])
    spread, infinite = np.log(high / low) / 1.349, 0.02
    measured, variance = np.array([0.5, 3.0, 9.0]), np.array([2.0, 1.5, 0.7])
    for y, r, mean, remaining in zip(
        measured, variance, *prior.posterior(measured, variance), strict=True
    ):
        x = np.linspace(1e-3, 40.0, 400_001)
        density = np.exp(-0.5 * (np.log(x / middle) / spread) ** 2) / (x * spread)
        weights = density * np.exp(-0.5 * (x - y) ** 2 / r) * (x[1] - x[0])
        # The share of points at infinity, whose disparity is zero.
        rest = np.sqrt(2 * np.pi) * infinite / (1 - infinite) * np.exp(-0.5 * y**2 / r)
        total = weights.sum() + rest
        exact = np.sum(weights * x) / total
        assert mean == pytest.approx(exact, abs=0.01)
        assert remaining == pytest.approx(np.sum(weights * x**2) / total - exact**2, rel=0.02)


def middle_of(prior):
    """What a posterior of a wide measurement is near to."""
    return prior.posterior(np.full(1, 8.0), np.full(1, 4.0))[0].item()


def test_a_hundred_landmarks_make_a_prior_and_each_fifty_renew_it():
    rng = np.random.default_rng(64)
    prior, found = DisparityPrior(), []
    for _ in range(200):
        prior.add(7.0 * np.exp(0.3 * rng.standard_normal(1)))
        found.append(middle_of(prior))
    changes = 1 + np.flatnonzero(np.diff([8.0, *found]))
    assert changes.tolist() == [100, 150, 200]


def test_two_thousand_landmarks_are_remembered():
    rng = np.random.default_rng(65)
    old, new = (middle * np.exp(0.3 * rng.standard_normal(2000)) for middle in (20.0, 7.0))
    prior, fresh = DisparityPrior(), learned(new)
    for part in (old, old, new[:1950]):
        prior.add(part)
    assert middle_of(prior) != middle_of(fresh)
    prior.add(new[1950:])
    assert middle_of(prior) == middle_of(fresh)


def quartiles_at(low, middle, high):
    """A prior that has seen nothing but these three."""
    return learned(np.repeat([low, middle, high], 100))


def test_quartiles_must_stand_out_of_the_noise_and_differ():
    measured = np.full(1, 3.5)
    for low, std, told in ((3.2, 2.0, True), (2.8, 2.0, False), (2.8, 1.8, True)):
        mean, _ = quartiles_at(low, 5.0, 8.0).posterior(measured, np.full(1, std**2))
        assert (mean != measured) == told
    # The best measurement of a frame decides for all.
    both = quartiles_at(2.8, 5.0, 8.0).posterior(np.full(2, 3.5), np.array([1.8, 9.0]) ** 2)[0]
    assert np.all(both != 3.5)
    for prior in (quartiles_at(5.0, 5.0, 5.0), DisparityPrior()):
        assert prior.posterior(measured, np.ones(1))[0] == measured


def test_a_posterior_of_three_standard_deviations_off_is_not_believed():
    prior = quartiles_at(6.8, 7.0, 7.2)
    for off, believed in ((2.9, True), (3.5, False)):
        mean, _ = prior.posterior(np.full(1, 7.0 + off), np.ones(1))
        assert mean == pytest.approx(7.0 if believed else 7.0 + off, abs=0.3)


def test_no_posterior_is_surer_than_a_tenth_of_the_measurements_variance():
    _, remaining = quartiles_at(6.99, 7.0, 7.01).posterior(np.full(1, 7.0), np.full(1, 2.0))
    assert remaining == pytest.approx(0.2)


def test_it_learns_from_what_it_is_applied_to():
    disparities, prior = scene(200)[1], DisparityPrior()
    y = np.column_stack([500.0 + disparities, np.full(200, 500.0), np.full(200, 100.0)])
    prior.apply(y, np.tile(np.eye(3), (200, 1, 1)))
    assert middle_of(prior) == pytest.approx(middle_of(learned(disparities)))
    assert middle_of(prior) < 7.9
