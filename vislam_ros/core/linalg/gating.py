# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates: which observations are inliers, by their innovation and its S (the report's eq. 69)."""

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.linear_update import (
    diagonal_blocks,
    downdate,
    innovation_covariance,
    keep_in_place,
    take,
)

Array = NDArray[np.float64]

# What goes at a time: all that is at least so much as far off as the farthest, in squares.
_AS_FAR_OFF = 0.5


@compiled("float64(int64, float64[:, :], float64[:, :, :], float64[::1], float64[:, ::1])")
def _squared_distance(n: int, residual: Array, covariance: Array, r: Array, C: Array) -> float:
    """Squared Mahalanobis distance of the n-th residual; r (k,) and C (k, k) are to work in.

    With ``C = L D L^T`` it is the sum of the squares of ``L^-1 r``, over D.
    """
    for i in range(len(r)):
        r[i] = residual[n, i]
        for j in range(i + 1):
            C[i, j] = covariance[n, i, j]
    distance = 0.0
    for k in range(len(r)):
        if C[k, k] == 0.0:
            raise np.linalg.LinAlgError("a covariance is singular")
        for i in range(k + 1, len(r)):
            factor = C[i, k] / C[k, k]
            r[i] -= factor * r[k]
            for j in range(k + 1, i + 1):
                C[i, j] -= factor * C[j, k]
        distance += r[k] * r[k] / C[k, k]
    return distance


@compiled("float64[::1](float64[:, :], float64[:, :, :])")
def mahalanobis_squared(residual: Array, covariance: Array) -> Array:
    """Squared Mahalanobis distances (n,) of residuals (n, r) with covariances (n, r, r)."""
    n, k = residual.shape
    r, C = np.empty(k), np.empty((k, k))
    distances = np.empty(n)
    for i in range(n):
        distances[i] = _squared_distance(i, residual, covariance, r, C)
    return distances


@compiled("boolean[::1](float64[:, :], float64[:, :, :], float64, float64)")
def passes_gates(
    residual: Array, covariance: Array, chi2_gate: float, pixel_gate: float
) -> NDArray[np.bool_]:
    """Tell which innovations are credible.

    Parameters
    ----------
    residual : ndarray, (n, r)
        Innovations, pixels.
    covariance : ndarray, (n, r, r)
        Of each innovation.
    chi2_gate : float
        Bound of the squared Mahalanobis distance of each innovation; 0 for none.
    pixel_gate : float
        Bound of each one's largest component, pixels; 0 for none.

    Returns
    -------
    ndarray of bool, (n,)
    """
    n, k = residual.shape
    r, C = np.empty(k), np.empty((k, k))
    passes = np.empty(n, dtype=np.bool_)
    for i in range(n):
        credible = True
        for j in range(k):
            small = pixel_gate <= 0 or abs(residual[i, j]) <= pixel_gate
            credible = credible and small and math.isfinite(residual[i, j])
        if credible and chi2_gate > 0:
            credible = _squared_distance(i, residual, covariance, r, C) <= chi2_gate
        passes[i] = credible
    return passes


class Inliers(NamedTuple):
    """Innovations that agree with each other.

    Attributes
    ----------
    indices : ndarray of int64, (k,)
        Which they are.
    inverse : ndarray, (k r, k r)
        Inverse of their joint covariance S.
    weighted : ndarray, (k r,)
        ``S^-1 r``.
    """

    indices: NDArray[np.int64]
    inverse: Array
    weighted: Array


def deletion_gate(chi2_gate: float, residual: Array, inverse: Array) -> Inliers:
    """Reject what all the others together contradict: the gate on deletion residuals.

    Where the motion is uncertain, so is every innovation, and a wrong one passes a gate of its
    own; but the others tell the motion. Of an innovation r_i given all the others, the squared
    Mahalanobis distance is ``w_i^T ((S^-1)_ii)^-1 w_i`` with ``w = S^-1 r``: the deletion residual
    of regression (Cook and Weisberg, *Residuals and Influence in Regression*, 1982, chapter 2).
    One wrong innovation makes others look wrong, so only those go at a time that are at least
    half as far off as the farthest.

    Parameters
    ----------
    chi2_gate : float
        Bound of the squared distance; 0 keeps all.
    residual : ndarray, (n, r)
        Innovations, pixels.
    inverse : ndarray, (n r, n r)
        Inverse of their joint covariance S.
    """
    r = residual.shape[1]
    inliers = Inliers(np.arange(len(residual)), inverse, inverse @ residual.ravel())
    while chi2_gate > 0 and len(inliers.indices):
        weighted = inliers.weighted.reshape(-1, r)
        distance = mahalanobis_squared(weighted, diagonal_blocks(inliers.inverse, r))
        worst = float(np.max(distance))
        if worst <= chi2_gate:
            break
        inliers = without(inliers, distance > max(chi2_gate, _AS_FAR_OFF * worst), residual)
    return inliers


def without(inliers: Inliers, wrong: NDArray[np.bool_], residual: Array) -> Inliers:
    """Leave some (k,) of the innovations (n, r) out: S^-1 is a Schur complement of itself.

    It is made in the place of that of the inliers given.
    """
    r = residual.shape[1]
    stay = np.flatnonzero(np.repeat(~wrong, r))
    go = np.flatnonzero(np.repeat(wrong, r))
    cross, own = np.empty((len(go), len(stay))), np.empty((len(go), len(go)))
    take(inliers.inverse, go, stay, cross)
    take(inliers.inverse, go, go, own)
    inverse = keep_in_place(inliers.inverse, stay)
    if cross.size:
        downdate(inverse, _whitened(own, cross))
    indices = inliers.indices[~wrong]
    return Inliers(indices, inverse, inverse @ residual[indices].ravel())


def with_more_noise(inliers: Inliers, more: Array, residual: Array) -> Inliers:
    """Give the inliers' numbers (k r,) more noise: S^-1 by Woodbury's formula.

    It is made in the place of that of the inliers given.

    Parameters
    ----------
    inliers : Inliers
    more : ndarray, (k r,)
        What is added to the diagonal of S, square pixels, nowhere negative.
    residual : ndarray, (k, r)
        The inliers' innovations, pixels.
    """
    changed = np.flatnonzero(more)
    if not len(changed):
        return inliers
    inverse, inner = inliers.inverse, np.empty((len(changed), len(changed)))
    innovation_covariance(inverse, changed, 1.0 / more[changed], inner)
    downdate(inverse, _whitened(inner, inverse[changed]))
    return Inliers(inliers.indices, inverse, inverse @ residual.ravel())


def _whitened(A: Array, B: Array) -> Array:
    """``(L^-1 B)^T`` (n, m) with ``A = L L^T`` (m, m): ``B^T A^-1 B`` is it times its transpose.

    It takes the place of B, which is C-ordered, as its transpose is in Fortran's order.
    """
    factor, failed = lapack.dpotrf(A, lower=1)
    if failed:
        raise scipy.linalg.LinAlgError("a part of S^-1 is not positive")
    white: Array = blas.dtrsm(1.0, factor, B.T, side=1, lower=1, trans_a=1, overwrite_b=1)
    return white


@compiled("float64[:, ::1](float64[:, :, ::1], float64[:, ::1])")
def _deletion_residuals(D: Array, w: Array) -> Array:
    """Forward substitution ``L^-1 w`` (n, r) for ``D = L L^T`` (n, r, r)."""
    n, r = w.shape
    white = w.copy()
    L = np.empty((r, r))
    for i in range(n):
        for j in range(r):
            for k in range(j + 1):
                L[j, k] = D[i, j, k]
                for m in range(k):
                    L[j, k] -= L[j, m] * L[k, m]
                if k < j:
                    L[j, k] /= L[k, k]
                    white[i, j] -= L[j, k] * white[i, k]
            L[j, j] = math.sqrt(L[j, j])
            white[i, j] /= L[j, j]
    return white


def deletion_residuals(inliers: Inliers, r: int) -> Array:
    """Innovations (k, r) given all the others, whitened: standard normal where all is right.

    With ``(S^-1)_ii = L L^T`` the deletion residual has covariance ``(L L^T)^-1`` and is ``(L
    L^T)^-1 w_i``, so ``L^-1 w_i`` is white; and innovations of different frames are independent.
    """
    white: Array = _deletion_residuals(
        diagonal_blocks(inliers.inverse, r), inliers.weighted.reshape(-1, r)
    )
    return white
