# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from vislam_ros.core.linalg.gating import deletion_gate
from vislam_ros.core.operations.direct_correction import (
    DirectCorrection,
    correct_gradually,
    seen_and_rest,
)
from vislam_ros.core.operations.error_state import ErrorState

S = 6
ALL, SOME = np.arange(3), np.array([0, 2])


def random_state(rng: np.random.Generator) -> ErrorState:
    half = rng.standard_normal((S + 15, S + 15))
    return ErrorState(half @ half.T, S)


@pytest.mark.parametrize("components", [ALL, SOME], ids=["all numbers", "two of three"])
@pytest.mark.parametrize("gated", [True, False], ids=["after a gate", "by itself"])
def test_correcting_by_landmarks_own_numbers_is_the_textbook_correction(
    components: NDArray[np.int64], gated: bool
) -> None:
    rng = np.random.default_rng(41)
    state = random_state(rng)
    slots, shape = np.array([4, 0, 3]), (3, len(components))
    correction = DirectCorrection(
        rng.standard_normal(shape), rng.uniform(0.5, 2.0, shape), slots, components
    )
    rows = (S + 3 * slots[:, None] + components).ravel()
    P, H = state.covariance.copy(), np.eye(S + 15)[rows]
    innovation = H @ P @ H.T + np.diag(correction.noise.ravel())
    K, r = P @ H.T @ np.linalg.inv(innovation), correction.residual.ravel()
    if gated:
        inverse = correction.inverse_in(state)
        inliers = deletion_gate(0.0, correction.residual, inverse)
        correction = DirectCorrection(
            r.reshape(shape), correction.noise, slots, components, inliers
        )
        assert correction.recorded().inliers is None
    corrected = state.apply(correction)
    assert_allclose(state.covariance, P - K @ H @ P, atol=1e-10)
    assert_allclose(corrected.delta, K @ r, atol=1e-10)
    assert corrected.nis == pytest.approx(r @ np.linalg.solve(innovation, r))


def unknown_twist_state(rng: np.random.Generator) -> ErrorState:
    """Landmarks that a vehicle known to thousands of pixels has been moved past."""
    motion = 1e3 * rng.standard_normal((S + 15, S))
    own = np.concatenate([np.zeros(S), np.full(15, 1e-3)])
    return ErrorState(motion @ motion.T + np.diag(own), S)


def precisely_corrected(P: NDArray[np.float64], R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance after all landmarks were observed with noise R, in extended precision."""
    wide = P.astype(np.longdouble)
    for k, variance in enumerate(R, start=S):  # one number at a time: nothing to invert
        column = wide[:, k].copy()
        wide -= np.outer(column, column) / (column[k] + variance)
    return wide.astype(np.float64)


def test_what_was_hardly_known_is_corrected_without_negative_variances() -> None:
    assert np.finfo(np.longdouble).eps < 1e-18, "the reference needs more digits than ours"
    rng = np.random.default_rng(5)
    noise = rng.uniform(0.5e-3, 2e-3, (5, 3))
    correction = DirectCorrection(rng.standard_normal((5, 3)), noise, np.arange(5), ALL)
    state = unknown_twist_state(rng)
    at_once = ErrorState(state.covariance, S)
    expected = precisely_corrected(state.covariance, noise.ravel())
    correct_gradually(state, correction)
    assert_allclose(np.diag(state.covariance), np.diag(expected), rtol=1e-3)
    assert np.linalg.eigvalsh(state.vehicle_covariance)[0] > 0
    # The same at once loses all digits, so that the rule is needed.
    at_once.apply(correction)
    assert np.linalg.eigvalsh(at_once.vehicle_covariance)[0] < 0


def test_a_correction_in_parts_moves_the_state_as_one_does() -> None:
    rng = np.random.default_rng(6)
    state = random_state(rng)
    once, P = ErrorState(state.covariance, S), state.covariance.copy()
    correction = DirectCorrection(
        1e-4 * rng.standard_normal((3, 3)), np.full((3, 3), 1e-8), np.array([4, 0, 3]), ALL
    )
    seen, _ = correction.seen_and_rest(state)
    assert P.diagonal()[seen].max() / 1e-8 > 1e7
    delta, single = correct_gradually(state, correction), once.apply(correction).delta
    assert_allclose(delta, single, rtol=1e-4, atol=1e-9)
    assert_allclose(state.covariance, once.covariance, atol=1e-6)


def test_a_usual_correction_is_one() -> None:
    rng = np.random.default_rng(7)
    state = random_state(rng)
    once = ErrorState(state.covariance, S)
    correction = DirectCorrection(rng.standard_normal((1, 3)), np.ones((1, 3)), np.array([1]), ALL)
    assert_array_equal(correct_gradually(state, correction), once.apply(correction).delta)
    assert_array_equal(state.covariance, once.covariance)


def test_what_is_seen_and_all_else_are_the_whole_error_state() -> None:
    seen, rest = seen_and_rest(np.array([2, 0]), ALL, 4, S)
    assert seen.tolist() == [12, 13, 14, 6, 7, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 9, 10, 11, 15, 16, 17]
    seen, rest = seen_and_rest(np.array([1, 0]), SOME, 2, S)
    assert seen.tolist() == [9, 11, 6, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 7, 10]
