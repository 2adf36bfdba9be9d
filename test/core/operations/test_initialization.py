# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.initialization import Initialization

S = 6


@pytest.mark.parametrize("correlated", [True, False])
def test_landmarks_join_with_what_they_share_with_the_vehicle(correlated: bool) -> None:
    rng = np.random.default_rng(51)
    half, noise = rng.standard_normal((S + 6, S + 6)), rng.standard_normal((2, 3, 3))
    P, noise = half @ half.T, noise @ np.swapaxes(noise, 1, 2)
    J = rng.standard_normal((2, 3, S)) if correlated else None
    state = ErrorState(P, S)
    # What an earlier, larger covariance has left in memory is not there.
    state.scratch.matrix("first", 50, 50)[:] = np.nan
    state.scratch.matrix("second", 50, 50)[:] = np.nan
    state.apply(Initialization(noise, J))
    G = np.zeros((S + 12, S + 6))
    G[: S + 6] = np.eye(S + 6)
    if J is not None:
        G[S + 6 :, :S] = J.reshape(6, S)
    expected = G @ P @ G.T
    for i in range(2):
        own = slice(S + 6 + 3 * i, S + 9 + 3 * i)
        expected[own, own] += noise[i]
    assert_allclose(state.covariance, expected, atol=1e-12)
    assert state.active == 4
    new = state.covariance[S + 6 :, S + 6 :]
    assert_array_equal(new, new.T)
