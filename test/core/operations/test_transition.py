# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.transition import (
    NewBeginning,
    RandomWalk,
    Transition,
    VehicleTransition,
)

S = 9


def random_state(rng: np.random.Generator, n: int) -> ErrorState:
    half = rng.standard_normal((S + 3 * n, S + 3 * n))
    return ErrorState(half @ half.T, S)


@pytest.mark.parametrize("corrected", [True, False], ids=["corrected before", "as it was"])
@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_transition_is_the_matrix_product(n: int, corrected: bool) -> None:
    rng = np.random.default_rng(n)
    state = random_state(rng, n)
    P = state.covariance.copy()
    A, D, C = (rng.standard_normal(shape) for shape in ((S, S), (n, 3, 3), (n, 3, S - 6)))
    # A column that is zero, as those of the biases are.
    C[:, :, 1] = 0.0
    if corrected:
        Y = 0.1 * rng.standard_normal((2, len(P)))
        state.defer_downdate(Y)
        P -= Y.T @ Y
    F = scipy.linalg.block_diag(A, *D)
    F[S:, 6:S] = C.reshape(3 * n, S - 6)
    state.apply(Transition(A, D, C))
    expected = F @ P @ F.T
    assert_allclose(state.covariance, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
    assert_array_equal(state.covariance, state.covariance.T)


@pytest.mark.parametrize("n", [0, 4])
def test_a_vehicle_moves_past_landmarks_that_stay(n: int) -> None:
    rng = np.random.default_rng(n)
    state = random_state(rng, n)
    P, A = state.covariance.copy(), rng.standard_normal((S, S))
    F = scipy.linalg.block_diag(A, np.eye(3 * n))
    state.apply(VehicleTransition(A))
    assert_allclose(state.covariance, F @ P @ F.T, rtol=1e-12, atol=1e-12)


def test_a_part_that_begins_anew_is_known_and_leaves_the_rest_as_it_was() -> None:
    state = random_state(np.random.default_rng(3), 2)
    P, others = state.covariance.copy(), np.delete(np.arange(S + 6), np.arange(8, S))
    state.apply(NewBeginning(slice(8, S)))
    assert_array_equal(state.covariance[np.ix_(others, others)], P[np.ix_(others, others)])
    assert not np.any(state.covariance[8:S])
    assert not np.any(state.covariance[:, 8:S])


def test_a_random_walk_is_the_vehicles_alone() -> None:
    rng = np.random.default_rng(5)
    state = random_state(rng, 2)
    P, Q = state.covariance.copy(), np.diag(rng.random(S))
    state.apply(RandomWalk(Q))
    P[:S, :S] += Q
    assert_array_equal(state.covariance, P)
