# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates of a constant by a plain Kalman filter, from measurements that are what they claim."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from plain_belief import birge_ratio

from vislam_ros.core.operations.bias_agreement import BiasAgreement

Array = NDArray[np.float64]

NO_WALK = np.zeros(3)
SECONDS = 0.1
STEPS = 1200
PRIOR_STD = 0.02
NOISE_STD = np.array([0.01, 0.02, 0.05])


def estimates(errors: Array) -> list[tuple[float, Array, Array]]:
    """Seconds, estimate and covariance after each measurement, of errors (n, 3)."""
    rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    R = rotation @ np.diag(NOISE_STD**2) @ rotation.T
    b, P = np.zeros(3), PRIOR_STD**2 * np.eye(3)
    taken = []
    for error in errors:
        K = P @ np.linalg.inv(P + R)
        b, P = b + K @ (0.004 + rotation @ error - b), P - K @ P
        taken.append((SECONDS, b, P))
    return taken


def ratio_of(taken: list[tuple[float, Array, Array]], walk: Array = NO_WALK) -> float:
    agreement = BiasAgreement()
    for seconds, b, P in taken:
        agreement.add(seconds, b, P, walk)
    return agreement.ratio


def white(seed: int) -> Array:
    return np.asarray(NOISE_STD * np.random.default_rng(seed).standard_normal((STEPS, 3)))


def that_stay(seed: int, steps: int) -> Array:
    """Errors of the same size, each of which lasts for so many steps."""
    return np.repeat(white(seed)[::steps], steps, axis=0)[:STEPS]


def test_before_a_drive_has_told_anything_it_is_that_of_recorded_drives() -> None:
    assert BiasAgreement().ratio == 10.0
    assert ratio_of(estimates(white(0))[:80]) == 10.0


def test_errors_that_are_what_they_are_taken_for_agree() -> None:
    ratios = [ratio_of(estimates(white(seed))) for seed in range(40)]
    # 22 moves of three numbers, and three of ten.
    expected = (66 + 30) / 69
    assert_allclose(np.mean(ratios), expected, atol=3 * np.sqrt(2 / 66 / 40))


@pytest.mark.parametrize("steps", [5, 10, 20])
def test_errors_that_stay_disagree_by_as_many_steps_as_they_last(steps: int) -> None:
    ratios = [ratio_of(estimates(that_stay(seed, steps))) for seed in range(40)]
    assert_allclose(np.mean(ratios), (66 * steps + 30) / 69, rtol=0.15)


def test_errors_smaller_than_they_are_taken_for_are_not_rewarded() -> None:
    assert ratio_of(estimates(0.1 * white(1))) == 1.0


@pytest.mark.parametrize("walk_std", [0.0, 0.001])
def test_it_is_the_mean_square_of_the_moves_by_the_textbook(walk_std: float) -> None:
    taken = estimates(that_stay(2, 7))
    walk = np.full(3, walk_std**2)
    assert_allclose(ratio_of(taken, walk), birge_ratio(taken, walk_std**2), rtol=1e-9)


def test_a_stretch_that_tells_nothing_is_taken_together_with_the_next() -> None:
    taken = estimates(white(4))
    blind = [(SECONDS, *taken[300][1:])] * 200
    of_little, of_much = taken[:301] + blind[:60], taken[:301] + blind
    assert ratio_of(of_much) == ratio_of(of_little)
    seen_again = of_much + taken[400:401]
    assert ratio_of(seen_again) != ratio_of(of_much)
    assert ratio_of(seen_again) == pytest.approx(birge_ratio(seen_again, 0.0))


def test_where_there_is_no_bias_nothing_is_said_of_it() -> None:
    assert ratio_of([(SECONDS, np.zeros(3), np.zeros((3, 3)))] * 200) == 10.0
