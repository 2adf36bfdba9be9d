# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.linalg.gating import deletion_gate
from vislam_ros.core.operations.direct_correction import DirectCorrection, seen_and_rest
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


def test_what_is_seen_and_all_else_are_the_whole_error_state() -> None:
    seen, rest = seen_and_rest(np.array([2, 0]), ALL, 4, S)
    assert seen.tolist() == [12, 13, 14, 6, 7, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 9, 10, 11, 15, 16, 17]
    seen, rest = seen_and_rest(np.array([1, 0]), SOME, 2, S)
    assert seen.tolist() == [9, 11, 6, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 7, 10]
