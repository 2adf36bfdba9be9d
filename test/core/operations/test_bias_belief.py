# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from plain_belief import PRIOR_AT_NONE, told_of_both
from scipy.special import expit, logit
from scipy.stats import multivariate_normal

from vislam_ros.core.operations.bias_belief import BiasBelief, bias_belief
from vislam_ros.core.operations.error_state import ErrorState

Array = NDArray[np.float64]
Rows = NDArray[np.int64] | slice

ROWS, SIZE = slice(5, 8), 9
PRIOR_STD = 0.02


def state(seed: int, bias_std: float = 0.005) -> Array:
    """Covariance (12, 12) of a vehicle and a landmark, of which the bias is in the vehicle."""
    half = np.random.default_rng(seed).standard_normal((12, 14))
    P: Array = half @ half.T
    scale = np.ones(12)
    scale[ROWS] = bias_std / np.sqrt(np.max(P.diagonal()[ROWS]))
    return scale[:, None] * P * scale


def belief_of(P: Array, bias: Array, temper: float = 10.0) -> BiasBelief:
    return bias_belief(P, ROWS, bias, PRIOR_STD**2, temper=temper)


def half_and_half(P: Array) -> tuple[BiasBelief, Array]:
    """A belief near a half, and the bias that makes it."""
    direction = np.array([1.0, -0.5, 0.8])
    scales = np.linspace(0.0, 0.1, 2000)
    shares = [belief_of(P, scale * direction).none for scale in scales]
    bias = scales[np.argmin(np.abs(np.array(shares) - 0.4))] * direction
    return belief_of(P, bias), bias


def log_odds(bias: Array, P_bb: Array) -> float:
    after = multivariate_normal(bias, P_bb).logpdf(np.zeros(3))
    before = multivariate_normal(np.zeros(3), PRIOR_STD**2 * np.eye(3)).logpdf(np.zeros(3))
    return float(logit(PRIOR_AT_NONE) + after - before)


@pytest.mark.parametrize("size", [0.0, 0.002, 0.01])
def test_untempered_the_data_change_the_odds_by_the_bias_density_at_zero_after_over_before(
    size: float,
) -> None:
    P, bias = state(81), size * np.array([0.6, -0.3, 1.0])
    assert_allclose(belief_of(P, bias, 1.0).none, expit(log_odds(bias, P[ROWS, ROWS])), rtol=1e-9)


def test_tempered_by_ten_the_datas_information_counts_as_a_tenth_of_itself() -> None:
    P, bias = state(82), np.array([0.004, -0.002, 0.006])
    prior = np.eye(3) / PRIOR_STD**2
    information = np.linalg.inv(P[ROWS, ROWS])
    P_tenth = np.asarray(np.linalg.inv(prior + (information - prior) / 10), dtype=np.float64)
    b_tenth = P_tenth @ information @ bias / 10
    assert_allclose(belief_of(P, bias).none, expit(log_odds(b_tenth, P_tenth)), rtol=1e-9)


def test_before_the_data_nearly_all_of_the_prior_is_at_none() -> None:
    P = np.eye(12)
    P[ROWS, ROWS] = PRIOR_STD**2 * np.eye(3)
    belief = belief_of(P, np.zeros(3))
    assert_allclose(belief.none, PRIOR_AT_NONE)
    # Whatever the belief, a bias of nothing moves nothing.
    assert_allclose(belief.delta, 0.0)


def change_of(belief: BiasBelief, rows: Rows, columns: Rows) -> Array:
    """What a block of the covariance grows by; rows and columns may be stacked."""
    columns_of = np.swapaxes(belief.gain[columns], -1, -2)
    return np.asarray(belief.gain[rows] @ belief.spread @ columns_of)


def test_mean_and_covariance_are_those_of_the_mixture_by_the_textbook() -> None:
    P = state(83)
    belief, bias = half_and_half(P)
    assert 0.3 < belief.none < 0.5
    told = told_of_both(P, ROWS, bias, PRIOR_STD**2, 10.0)
    everything = slice(None)
    assert_allclose(belief.none, told.none, rtol=1e-9)
    assert_allclose(belief.delta, told.mean, atol=1e-12)
    assert_allclose(P + change_of(belief, everything, everything), told.covariance, atol=1e-12)
    # The bias itself is between what it is where there is one and none.
    assert_allclose(bias + belief.delta[ROWS], (1 - belief.none) * bias)


def test_what_is_told_of_the_bias_is_no_surer_than_the_two_beliefs_are_near() -> None:
    P, bias = state(90), np.array([2e-3, -1e-3, 5e-4])
    for none in (0.0, 0.3, 1.0):
        belief = belief_of(P, bias)._replace(none=none)
        told = bias + belief.delta[ROWS]
        assert_allclose(belief.bias_std**2, P.diagonal()[ROWS] + (told - bias) ** 2)


def test_certain_of_none_all_is_conditioned_on_it() -> None:
    P, bias = state(84), np.array([1e-4, 0.0, 0.0])
    belief = belief_of(P, bias)._replace(none=1.0)
    change = change_of(belief, slice(None), slice(None))
    others = np.setdiff1d(np.arange(12), np.arange(12)[ROWS])
    # What remains, by the information form of the same Gaussian.
    remains = np.linalg.inv(np.linalg.inv(P)[np.ix_(others, others)])
    assert_allclose((P + change)[np.ix_(others, others)], remains, rtol=1e-7)
    assert_allclose((P + change)[ROWS], 0.0, atol=1e-9)


def test_blocks_of_many_landmarks_are_changed_at_once() -> None:
    P = state(85)
    belief, _ = half_and_half(P)
    whole = change_of(belief, slice(None), slice(None))
    rows, columns = np.array([[0, 1, 2], [9, 10, 11]]), np.array([0, 1, 8])
    for i, row in enumerate(rows):
        assert_allclose(change_of(belief, rows, rows)[i], whole[np.ix_(row, row)], atol=1e-15)
        assert_allclose(
            change_of(belief, rows, columns)[i], whole[np.ix_(row, columns)], atol=1e-15
        )


def test_to_the_way_back_it_is_a_correction_with_the_same_mean_and_no_spread() -> None:
    P = state(86)
    belief, bias = half_and_half(P)
    correction = belief.as_correction(ROWS, SIZE)
    assert correction is not None
    state_ = ErrorState(P, SIZE)
    assert_allclose(state_.apply(correction).delta, belief.delta, rtol=1e-9, atol=1e-12)
    told = told_of_both(P, ROWS, bias, PRIOR_STD**2, 10.0)
    assert_allclose(state_.covariance, told.within, rtol=0, atol=1e-9)


def test_a_belief_in_a_bias_alone_is_no_correction() -> None:
    P, sure = state(87), np.full(3, 1.0)
    assert belief_of(P, sure).none < 1e-9
    assert belief_of(P, sure).as_correction(ROWS, SIZE) is None


def test_where_there_is_no_bias_to_weigh_nothing_is_weighed() -> None:
    P = state(88)
    P[ROWS] = P[:, ROWS] = 0.0
    belief = bias_belief(P, ROWS, np.zeros(3), 0.0, temper=10.0)
    assert belief.none == 0.0
    assert_allclose(belief.delta, np.zeros(12))
    assert_allclose(change_of(belief, slice(None), slice(None)), np.zeros((12, 12)))
    assert belief.as_correction(ROWS, SIZE) is None


def drawn(bias: float, noise_std: float, draws: int) -> Array:
    """Beliefs in none, each after a measurement of the bias on each axis."""
    rng = np.random.default_rng(89)
    variance = 1 / (1 / PRIOR_STD**2 + 1 / noise_std**2)
    P = variance * np.eye(3)
    shares = []
    for _ in range(draws):
        measured = bias + noise_std * rng.standard_normal(3)
        estimate = variance / noise_std**2 * measured
        shares.append(bias_belief(P, slice(0, 3), estimate, PRIOR_STD**2, temper=10.0).none)
    return np.array(shares)


@pytest.mark.parametrize("noise_std", [0.0002, 0.001])
def test_of_drives_without_a_bias_nearly_all_are_taken_for_such(noise_std: float) -> None:
    assert np.mean(drawn(0.0, noise_std, 300) > 0.5) > 0.95


def test_of_drives_with_a_clear_bias_none_is_taken_for_one_without() -> None:
    assert np.max(drawn(0.02, 0.001, 300)) < 1e-3


def test_the_odds_are_right_where_nothing_is_tempered() -> None:
    rng = np.random.default_rng(90)
    noise_std = 0.01
    P = np.eye(3) / (1 / PRIOR_STD**2 + 1 / noise_std**2)
    none, beliefs = rng.random(20_000) < 0.5, []
    for without in none:
        bias = np.zeros(3) if without else PRIOR_STD * rng.standard_normal(3)
        estimate = P @ (bias + noise_std * rng.standard_normal(3)) / noise_std**2
        beliefs.append(bias_belief(P, slice(0, 3), estimate, PRIOR_STD**2, temper=1.0).none)
    # Had as many none as have one, of those with a belief of so much so many have none.
    shares = expit(logit(np.array(beliefs)) - logit(PRIOR_AT_NONE))
    for low in np.arange(0.1, 0.9, 0.2):
        chosen = (shares >= low) & (shares < low + 0.2)
        assert abs(np.mean(none[chosen]) - np.mean(shares[chosen])) < 0.05
