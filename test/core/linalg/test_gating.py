# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.linalg.gating import (
    Inliers,
    deletion_gate,
    deletion_residuals,
    mahalanobis_squared,
    passes_gates,
    without,
)
from vislam_ros.core.linalg.linear_update import diagonal_blocks


def test_the_chi_square_gate_lets_its_share_of_honest_innovations_pass():
    rng = np.random.default_rng(19)
    half = rng.standard_normal((20000, 3, 3))
    covariance = half @ np.swapaxes(half, 1, 2) + 0.1 * np.eye(3)
    root = np.linalg.cholesky(covariance)
    residual = (root @ rng.standard_normal((20000, 3, 1)))[..., 0]
    # 16.27 is the 99.9 % quantile of chi-square with 3 degrees of freedom.
    inliers = passes_gates(residual, covariance, 16.27, 0.0)
    assert 0.0003 < 1 - inliers.mean() < 0.002
    assert abs(mahalanobis_squared(residual, covariance).mean() - 3) < 0.1


@pytest.mark.parametrize("rows", [1, 3, 4])
def test_the_mahalanobis_distance_is_that_of_the_inverse(rows):
    rng = np.random.default_rng(rows)
    half, residual = rng.standard_normal((50, rows, rows)), rng.standard_normal((50, rows))
    covariance = half @ np.swapaxes(half, 1, 2) + 0.1 * np.eye(rows)
    expected = [r @ np.linalg.inv(C) @ r for r, C in zip(residual, covariance, strict=True)]
    np.testing.assert_allclose(mahalanobis_squared(residual, covariance), expected, rtol=1e-9)
    covariance[7] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        mahalanobis_squared(residual, covariance)


def test_the_pixel_gate_bounds_each_component():
    residual = np.array([[0.0, 4.9, 0.0], [0.0, 0.0, -5.1]])
    covariance = 100 * np.broadcast_to(np.eye(3), (2, 3, 3))
    inliers = passes_gates(residual, covariance, 0.0, 5.0)
    assert inliers.tolist() == [True, False]


def test_gates_at_zero_are_off():
    residual, covariance = np.full((1, 3), 1e6), np.eye(3)[None]
    assert passes_gates(residual, covariance, 0.0, 0.0).all()


def test_a_non_finite_innovation_never_passes():
    residual, covariance = np.array([[np.nan, 0, 0], [np.inf, 0, 0]]), np.stack([np.eye(3)] * 2)
    assert not passes_gates(residual, covariance, 0.0, 0.0).any()


def test_no_observations_pass_no_gate():
    assert passes_gates(np.empty((0, 3)), np.empty((0, 3, 3)), 16.27, 0.0).shape == (0,)


def shared_motion(count, rng):
    """Innovations that one uncertain motion moves alike, each with noise of its own."""
    direction = rng.standard_normal((3 * count, 6))
    S = 100.0 * direction @ direction.T + np.eye(3 * count)
    return S, (np.linalg.cholesky(S) @ rng.standard_normal(3 * count)).reshape(count, 3)


def test_what_the_others_contradict_is_found_where_its_own_gate_is_wide_open():
    rng = np.random.default_rng(20)
    S, residual = shared_motion(30, rng)
    wrong = [3, 17, 18]
    residual[wrong] += 8.0 * rng.choice([-1, 1], (3, 3))
    alone = mahalanobis_squared(residual, diagonal_blocks(S, 3))
    assert np.all(alone[wrong] < 16.27)
    agreed = deletion_gate(16.27, residual, np.linalg.inv(S))
    assert np.setdiff1d(np.arange(30), agreed.indices).tolist() == wrong
    rows = (3 * agreed.indices[:, None] + np.arange(3)).ravel()
    inverse = np.linalg.inv(S[np.ix_(rows, rows)])
    np.testing.assert_allclose(agreed.inverse, inverse, atol=1e-9)
    # As corrections take it.
    assert agreed.inverse.flags.c_contiguous
    np.testing.assert_allclose(agreed.weighted, inverse @ residual.ravel()[rows], atol=1e-8)


def test_honest_innovations_are_contradicted_as_often_as_chi_square_says():
    rng = np.random.default_rng(21)
    kept = 0
    for _ in range(200):
        S, residual = shared_motion(30, rng)
        kept += len(deletion_gate(16.27, residual, np.linalg.inv(S)).indices)
    assert 0.0003 < 1 - kept / 6000 < 0.003


def test_without_a_gate_all_innovations_agree():
    agreed = deletion_gate(0.0, np.full((4, 3), 1e6), np.eye(12))
    assert agreed.indices.tolist() == [0, 1, 2, 3]
    assert len(deletion_gate(16.27, np.empty((0, 3)), np.empty((0, 0))).indices) == 0


@pytest.mark.parametrize("rows", [2, 3])
def test_what_is_left_out_leaves_the_inverse_of_what_stays(rows):
    rng = np.random.default_rng(22)
    S = joint_covariance(8, rows, rng)
    residual = rng.standard_normal((8, rows))
    inverse = np.linalg.inv(S)
    all_of_them = Inliers(np.arange(8), inverse, inverse @ residual.ravel())
    none = without(all_of_them, np.zeros(8, dtype=bool), residual)
    np.testing.assert_allclose(none.inverse, inverse)
    left = all_of_them
    # And once more, of what has stayed.
    for gone, indices in (([1, 6], [0, 2, 3, 4, 5, 7]), ([0, 7], [2, 3, 4, 5])):
        left = without(left, np.isin(left.indices, gone), residual)
        assert left.indices.tolist() == indices
        places = (rows * left.indices[:, None] + np.arange(rows)).ravel()
        expected = np.linalg.inv(S[np.ix_(places, places)])
        np.testing.assert_allclose(left.inverse, expected, atol=1e-9)
        np.testing.assert_allclose(left.weighted, expected @ residual.ravel()[places], atol=1e-9)
        assert left.inverse.flags.c_contiguous
        np.testing.assert_array_equal(left.inverse, left.inverse.T)


def joint_covariance(count, rows, rng):
    half = rng.standard_normal((rows * count, rows * count + 3))
    return half @ half.T + 0.5 * np.eye(rows * count)


@pytest.mark.parametrize("rows", [2, 3])
def test_deletion_residuals_are_innovations_given_all_the_others_whitened(rows):
    rng = np.random.default_rng(23)
    S = joint_covariance(6, rows, rng)
    residual = rng.standard_normal((6, rows))
    inverse = np.linalg.inv(S)
    inliers = Inliers(np.arange(6), inverse, inverse @ residual.ravel())
    white = deletion_residuals(inliers, rows)
    for i in range(6):
        own = rows * i + np.arange(rows)
        others = np.setdiff1d(np.arange(6 * rows), own)
        gain = S[np.ix_(own, others)] @ np.linalg.inv(S[np.ix_(others, others)])
        error = residual[i] - gain @ residual.ravel()[others]
        covariance = S[np.ix_(own, own)] - gain @ S[np.ix_(others, own)]
        # A root of the covariance's inverse; upper triangular, by which each number is one's own.
        root = np.linalg.cholesky(np.linalg.inv(covariance)).T
        np.testing.assert_allclose(white[i], root @ error, atol=1e-9)
        np.testing.assert_allclose(white[i] @ white[i], error @ np.linalg.solve(covariance, error))


def test_deletion_residuals_of_right_innovations_are_white():
    rng = np.random.default_rng(24)
    S = joint_covariance(5, 3, rng)
    inverse, root = np.linalg.inv(S), np.linalg.cholesky(S)
    found = []
    for _ in range(20_000):
        weighted = inverse @ root @ rng.standard_normal(15)
        found.append(deletion_residuals(Inliers(np.arange(5), inverse, weighted), 3))
    for of_one in np.swapaxes(found, 0, 1):
        np.testing.assert_allclose(np.cov(of_one.T), np.eye(3), atol=0.05)
        np.testing.assert_allclose(np.mean(of_one, axis=0), 0.0, atol=0.03)


def test_of_no_innovations_there_are_no_deletion_residuals():
    nothing = Inliers(np.arange(0), np.empty((0, 0)), np.empty(0))
    assert deletion_residuals(nothing, 3).shape == (0, 3)
