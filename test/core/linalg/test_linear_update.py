# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from vislam_ros.core.linalg.linear_update import (
    correct,
    correct_directly,
    diagonal_blocks,
    downdate,
    innovation_covariance,
    inverse_of_positive,
    keep_in_place,
    marginal,
    mirror_lower,
    mirror_upper,
    take,
    whitened,
)
from vislam_ros.core.linalg.scratch import Scratch


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
    found = correct(corrected, S.copy(), H @ P, r)
    assert_allclose(found.delta, K @ r, atol=1e-9)
    assert_allclose(corrected, expected, atol=1e-9)
    assert found.nis == pytest.approx(nis)
    L = np.tril(found.L)
    assert_allclose(L @ L.T, S, atol=1e-9)
    assert_allclose(L @ found.Y, H @ P, atol=1e-9)
    assert_allclose(L @ found.whitened, r, atol=1e-9)
    assert np.array_equal(corrected, corrected.T)


def test_a_residual_covariance_that_is_not_positive_leaves_all_as_it_was():
    P, H, r = problem(20, 5)
    before = P.copy()
    with pytest.raises(scipy.linalg.LinAlgError, match="not positive"):
        correct(P, -np.eye(5), H @ P, r)
    assert np.array_equal(P, before)


@pytest.mark.parametrize("size", [1, 3, 49, 50, 51, 200])
def test_the_inverse_of_a_positive_matrix_is_symmetric_to_the_last_bit(size):
    S = problem(size, 1)[0] + np.eye(size)
    into = S.copy()
    inverse = inverse_of_positive(into)
    assert_allclose(inverse @ S, np.eye(size), atol=1e-10)
    assert np.array_equal(inverse, inverse.T)
    assert np.shares_memory(inverse, into)
    with pytest.raises(scipy.linalg.LinAlgError, match="not positive"):
        inverse_of_positive(-S)


@pytest.mark.parametrize("whole", [True, False], ids=["all landmarks seen", "some, in any order"])
def test_correcting_by_components_themselves_is_the_textbook_correction(whole):
    P, _, _ = problem(40, 1)
    seen = np.arange(10, 40)
    if not whole:
        seen = np.random.default_rng(3).permutation(seen)[:18]
    rest = np.setdiff1d(np.arange(40), seen)
    noise = np.resize([0.7, 1.1, 0.4], len(seen))
    H = np.eye(40)[seen]
    S = H @ P @ H.T + np.diag(noise)
    K = P @ H.T @ np.linalg.inv(S)
    corrected = P.copy()
    cross = correct_directly(corrected, seen, rest, noise, np.linalg.inv(S))
    assert_allclose(corrected, P - K @ S @ K.T, atol=1e-10)
    assert_allclose(corrected, corrected.T, atol=1e-12)
    assert_allclose(cross, P[rest][:, seen])


def test_a_few_rows_whitened_are_the_textbook_correction():
    P, _, residual = problem(40, 8)
    H = np.random.default_rng(4).standard_normal((8, 12))
    H[:, 3:7] = 0.0
    noise = np.linspace(0.5, 2.0, 8)
    full = np.hstack([H, np.zeros((8, 28))])
    S = full @ P @ full.T + np.diag(noise)
    K = P @ full.T @ np.linalg.inv(S)
    Y, white, L = whitened(P, H, noise, residual)
    assert_allclose(L @ L.T, S, atol=1e-9)
    assert_allclose(P - Y.T @ Y, P - K @ S @ K.T, atol=1e-9)
    assert_allclose(white @ Y, K @ residual, atol=1e-9)
    assert white @ white == pytest.approx(residual @ np.linalg.solve(S, residual))
    with pytest.raises(np.linalg.LinAlgError, match="not positive"):
        whitened(-P, H, noise, residual)


@pytest.mark.parametrize(
    "columns", [[], [4], [2, 3, 4, 5], [0, 1, 5, 6, 8], [7, 6, 5], [8, 1, 2, 0]], ids=str
)
def test_any_rows_and_columns_are_taken_in_their_order(columns):
    P, places = problem(9, 1)[0], np.array(columns, dtype=np.int64)
    rows = np.array([6, 0, 7])
    taken = np.full((3, len(columns)), np.nan)
    take(P, rows, places, taken)
    assert np.array_equal(taken, P[np.ix_(rows, places)])
    noise = np.arange(1.0, 1.0 + len(columns))
    S = np.full((len(columns), len(columns)), np.nan)
    innovation_covariance(P, places, noise, S)
    assert np.array_equal(S, P[np.ix_(places, places)] + np.diag(noise))


def test_diagonal_blocks_are_copies_of_those_of_any_view():
    P = problem(14, 1)[0]
    blocks = diagonal_blocks(P[2:, 2:], 3)
    assert np.array_equal(blocks, [P[k : k + 3, k : k + 3] for k in (2, 5, 8, 11)])
    blocks[:] = 0.0
    assert np.all(np.diag(P) != 0.0)


@pytest.mark.parametrize("rows", [[], [0], [1, 2, 5], range(7), [3, 4, 6]])
def test_rows_are_kept_in_the_matrix_own_memory(rows):
    P = np.random.default_rng(4).standard_normal((7, 7))
    rows = np.array(rows, dtype=np.int64)
    expected = P[np.ix_(rows, rows)]
    kept = keep_in_place(P, rows)
    np.testing.assert_array_equal(kept, expected)
    assert kept.flags.c_contiguous
    assert not len(rows) or np.shares_memory(kept, P)


def test_a_downdate_takes_a_square_off_and_stays_symmetric_to_the_last_bit():
    P, Y, _ = problem(30, 5)
    expected = P - Y.T @ Y
    downdate(P, np.asfortranarray(Y.T))
    assert_allclose(P, expected, atol=1e-12)
    np.testing.assert_array_equal(P, P.T)


def test_components_left_out_leave_the_rest_as_it_was():
    scratch = Scratch()
    P, kept = problem(9, 1)[0], np.array([0, 1, 4, 8])
    rest = marginal(P, kept, scratch)
    assert np.array_equal(rest, P[np.ix_(kept, kept)])
    # What comes next does not write over what it comes from.
    assert np.array_equal(marginal(rest, np.arange(3), scratch), P[np.ix_(kept[:3], kept[:3])])
    assert np.array_equal(rest, P[np.ix_(kept, kept)])


def test_the_inverse_stays_positive_where_a_few_directions_are_hardly_known() -> None:
    # Image points before the motion is known: all that they share is known to 3000 pixels.
    rng = np.random.default_rng(8)
    shared = rng.standard_normal((330, 6))
    S = 1e7 * shared @ shared.T + 5e-3 * np.eye(330)
    inverse = inverse_of_positive(S.copy())
    assert np.all(np.linalg.eigvalsh(inverse) > -1e-6)
    # What the others do not tell of a number is its own noise.
    assert_allclose(1.0 / inverse.diagonal(), 5e-3, rtol=0.2)
    noise = np.sqrt(5e-3) * rng.standard_normal(330)
    assert noise @ inverse @ noise == pytest.approx(330 - 6, rel=0.2)


def test_the_inverse_of_nothing_is_nothing(capfd):
    assert inverse_of_positive(np.empty((0, 0))).shape == (0, 0)
    assert capfd.readouterr().out == ""


def test_mirroring_takes_one_triangle_at_every_size():
    rng = np.random.default_rng(33)
    for size in (3, 50, 7):
        P = rng.standard_normal((size, size))
        upper = np.triu(P)
        mirror_upper(P)
        assert np.array_equal(P, upper + np.triu(upper, 1).T)
        Q = rng.standard_normal((size, size))
        lower = np.tril(Q)
        mirror_lower(Q)
        assert np.array_equal(Q, lower + np.tril(lower, -1).T)
