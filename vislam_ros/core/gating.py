# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gates: which observations to believe."""

import numpy as np
from numpy.typing import NDArray

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
