# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a filter knows its own error: NEES, and what chi-square allows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]

_DOF = 6

# A covariance whose correlation matrix has a smaller eigenvalue than this has no inverse.
_SINGULAR = 1e-12

#: What share of the poses of an honest filter lies inside the bounds.
SHARE_INSIDE = 0.95


def pose_errors(T_reference: Array, T_estimate: Array) -> Array:
    """Errors ``xi = Log(T_hat^-1 T)`` of poses, both first poses being the identity.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)

    Returns
    -------
    ndarray, (n, 6)
        ``[rho; theta]`` in the estimate's body axes, metres and radians.
    """
    T_reference = se3.inverse(T_reference[0]) @ T_reference
    T_estimate = se3.inverse(T_estimate[0]) @ T_estimate
    return se3.log(se3.inverse(T_estimate) @ T_reference)


def normalised_errors(T_reference: Array, T_estimate: Array, covariances: Array) -> Array:
    """Normalised estimation error squared of each pose: ``xi^T Sigma^-1 xi / 6``.

    ``xi`` is that of :func:`pose_errors`. A filter that knows its own error has a mean of 1.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)
    covariances : ndarray, (n, 6, 6)
        Of ``xi``, in the body frame.

    Returns
    -------
    ndarray, (n,)
        NaN where the covariance is singular or not known.
    """
    xi = pose_errors(T_reference, T_estimate)
    result = np.full(len(xi), np.nan)
    # The correlation matrix, free of units, tells whether the covariance has an inverse.
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    rows = np.flatnonzero(np.isfinite(covariances).all(axis=(1, 2)) & (variances > 0).all(axis=1))
    std = np.sqrt(variances[rows])
    correlations = covariances[rows] / (std[:, :, None] * std[:, None, :])
    regular = np.linalg.eigvalsh(correlations)[:, 0] > _SINGULAR
    rows, correlations = rows[regular], correlations[regular]
    scaled = (xi[rows] / std[regular])[:, :, None]
    result[rows] = np.sum(scaled * np.linalg.solve(correlations, scaled), axis=(1, 2)) / _DOF
    return result


def chi_square_band(dof: NDArray[np.int64] | int) -> tuple[Array, Array]:
    """Bounds of chi-square by its degrees of freedom that hold 95 %, two-sided; at least one."""
    outside = (1 - SHARE_INSIDE) / 2
    dof = np.asarray(dof)
    return chi2.ppf(outside, dof) / dof, chi2.ppf(1 - outside, dof) / dof


def nees_bounds() -> tuple[float, float]:
    """Bounds of the NEES by its 6 degrees of freedom that hold 95 % of an honest filter's poses.

    Two-sided, of chi-square (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to
    Tracking and Navigation*, 2001, section 5.4). They are those of one pose. The errors of a
    drive's poses belong together, so they bound the drive's mean, too; how much narrower its own
    bounds are depends on how many of the errors are independent.
    """
    low, high = chi_square_band(_DOF)
    return float(low), float(high)


def consistency_figures(nees: Array) -> dict[str, Any]:
    """Sum up the NEES (n,) of poses, NaN where it is not known.

    Returns
    -------
    dict
        Mean ``nees_per_dof`` of ``nees_poses`` poses, ``nees_left_out`` others not being known;
        ``nees_bounds`` of each, and ``nees_inside``, the share of poses within them.
    """
    known = nees[np.isfinite(nees)]
    low, high = nees_bounds()
    inside = (known >= low) & (known <= high)
    return {
        "nees_per_dof": float(np.mean(known)) if len(known) else None,
        "nees_poses": len(known),
        "nees_left_out": len(nees) - len(known),
        "nees_bounds": [low, high],
        "nees_inside": float(np.mean(inside)) if len(known) else None,
    }
