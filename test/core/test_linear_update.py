# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from vislam_ros.core.linear_update import correct, mirror_upper


def problem(size, rows):
    rng = np.random.default_rng(size + rows)
    half = rng.standard_normal((size, size))
    P, H = half @ half.T, rng.standard_normal((rows, size))
    return 0.5 * (P + P.T), H, rng.standard_normal(rows)


@pytest.mark.parametrize(("size", "rows"), [(7, 1), (40, 30), (60, 48), (90, 49), (200, 150)])
def test_it_is_the_textbook_correction_made_in_place(size, rows):
    P, H, r = problem(size, rows)
    S = H @ P @ H.T + np.eye(rows)
    K = P @ H.T @ np.linalg.inv(S)
    expected, nis = P - K @ S @ K.T, r @ np.linalg.solve(S, r)
    corrected = P.copy()
    delta, found = correct(corrected, S.copy(), H @ P, r)
    assert_allclose(delta, K @ r, atol=1e-9)
    assert_allclose(corrected, expected, atol=1e-9)
    assert found == pytest.approx(nis)
    assert np.array_equal(corrected, corrected.T)


def test_a_residual_covariance_that_is_not_positive_leaves_all_as_it_was():
    P, H, r = problem(20, 5)
    before = P.copy()
    with pytest.raises(scipy.linalg.LinAlgError, match="not positive"):
        correct(P, -np.eye(5), H @ P, r)
    assert np.array_equal(P, before)


def test_mirroring_takes_the_upper_triangle_at_every_size():
    rng = np.random.default_rng(33)
    for size in (3, 50, 7):
        P = rng.standard_normal((size, size))
        upper = np.triu(P)
        mirror_upper(P)
        assert np.array_equal(P, upper + np.triu(upper, 1).T)
