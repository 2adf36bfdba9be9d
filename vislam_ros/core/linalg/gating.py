# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates: which observations are inliers, by their innovation and its S (the report's eq. 69)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.linear_update import diagonal_blocks
from vislam_ros.core.motion import symmetrized

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
    half as far off as the farthest; without them S^-1 is a Schur complement of itself.

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
    inliers = np.arange(len(residual))
    weighted = inverse @ residual.ravel()
    while chi2_gate > 0 and len(inliers):
        distance = mahalanobis_squared(weighted.reshape(-1, r), diagonal_blocks(inverse, r))
        worst = float(np.max(distance))
        if worst <= chi2_gate:
            break
        wrong = distance > max(chi2_gate, _AS_FAR_OFF * worst)
        stay = np.flatnonzero(np.repeat(~wrong, r))
        go = np.flatnonzero(np.repeat(wrong, r))
        cross = inverse[np.ix_(stay, go)]
        change = cross @ np.linalg.solve(inverse[np.ix_(go, go)], cross.T)
        inverse = inverse[np.ix_(stay, stay)] - symmetrized(change)
        inliers = inliers[~wrong]
        weighted = inverse @ residual[inliers].ravel()
    return Inliers(inliers, inverse, weighted)
