# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates: which observations to believe."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linear_update import diagonal_blocks
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.settings import SlamSettings

Array = NDArray[np.float64]


def mahalanobis_squared(residual: Array, covariance: Array) -> Array:
    """Squared Mahalanobis distances (n,) of residuals (n, r) with covariances (n, r, r)."""
    weighted = np.linalg.solve(covariance, residual[..., None])[..., 0]
    return np.einsum("ni,ni->n", residual, weighted)


def passes_gates(settings: SlamSettings, residual: Array, covariance: Array) -> NDArray[np.bool_]:
    """Tell which innovations are credible.

    Parameters
    ----------
    settings : SlamSettings
        Its ``chi2_gate`` bounds the squared Mahalanobis distance of each innovation, its
        ``pixel_gate`` each one's largest component; 0 turns a gate off.
    residual : ndarray, (n, r)
        Innovations, pixels.
    covariance : ndarray, (n, r, r)
        Of each innovation.

    Returns
    -------
    ndarray of bool, (n,)
    """
    passed = np.all(np.isfinite(residual), axis=1)
    if settings.pixel_gate > 0:
        passed &= np.max(np.abs(residual), axis=1, initial=0.0) <= settings.pixel_gate
    if settings.chi2_gate > 0:
        passed &= mahalanobis_squared(residual, covariance) <= settings.chi2_gate
    return passed


@dataclass(frozen=True)
class Consensus:
    """Innovations that agree with each other.

    Attributes
    ----------
    kept : ndarray of int64, (k,)
        Which they are.
    inverse : ndarray, (3 k, 3 k)
        Inverse of their joint covariance.
    """

    kept: NDArray[np.int64]
    inverse: Array


def consensus(chi2_gate: float, residual: Array, inverse: Array) -> Consensus:
    """Reject what all the others together contradict.

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
    kept = np.arange(len(residual))
    while chi2_gate > 0 and len(kept):
        n = len(kept)
        weighted = (inverse @ residual[kept].ravel()).reshape(n, r)
        distance = mahalanobis_squared(weighted, diagonal_blocks(inverse, r))
        worst = float(np.max(distance))
        if worst <= chi2_gate:
            break
        wrong = distance > max(chi2_gate, 0.5 * worst)
        stay = np.flatnonzero(np.repeat(~wrong, r))
        go = np.flatnonzero(np.repeat(wrong, r))
        cross = inverse[np.ix_(stay, go)]
        change = cross @ np.linalg.solve(inverse[np.ix_(go, go)], cross.T)
        inverse = inverse[np.ix_(stay, stay)] - symmetrized(change)
        kept = kept[~wrong]
    return Consensus(kept, inverse)
