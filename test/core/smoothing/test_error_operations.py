# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.core.linalg.linear_update import Scratch
from vislam_ros.core.smoothing.error_operations import Transition, seen_and_rest


@pytest.mark.parametrize("coupled", [True, False], ids=["coupled", "apart"])
@pytest.mark.parametrize("corrected", [True, False], ids=["corrected before", "as it was"])
@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_transition_is_the_matrix_product(n: int, corrected: bool, coupled: bool) -> None:
    rng = np.random.default_rng(n)
    s, size = 9, 9 + 3 * n
    half = rng.standard_normal((size, size))
    P = half @ half.T
    A, D, C = (rng.standard_normal(shape) for shape in ((s, s), (n, 3, 3), (n, 3, s - 6)))
    # A column that is zero, as those of the biases are.
    C[:, :, 1] = 0.0
    Y = 0.1 * rng.standard_normal((2, size)) if corrected else None
    F = scipy.linalg.block_diag(A, *D)
    if coupled:
        F[s:, 6:s] = C.reshape(3 * n, s - 6)
    expected = F @ (P if Y is None else P - Y.T @ Y) @ F.T
    transition = Transition(A, D, C if coupled else None)
    carried, _ = transition.carry(P.copy(), s, Scratch(), Y)
    assert_allclose(carried, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
    assert_array_equal(carried, carried.T)


def test_what_is_seen_and_all_else_are_the_whole_error_state() -> None:
    seen, rest = seen_and_rest(np.array([2, 0]), np.arange(3), 4, 6)
    assert seen.tolist() == [12, 13, 14, 6, 7, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 9, 10, 11, 15, 16, 17]
    seen, rest = seen_and_rest(np.array([1, 0]), np.array([0, 2]), 2, 6)
    assert seen.tolist() == [9, 11, 6, 8]
    assert rest.tolist() == [0, 1, 2, 3, 4, 5, 7, 10]
