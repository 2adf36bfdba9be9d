# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Correction of a pose by many observations at once, in the size of the pose.

The report's eq. 16-18 and 59-61 in the information form, equal by Woodbury's identity.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def corrected_by_information(covariance: Array, information: Array) -> Array:
    """Covariance ``(Sigma^-1 + A)^-1``, for a Sigma that may be singular.

    With ``Sigma = L L^T`` it is ``L (I + L^T A L)^-1 L^T``, which needs no inverse of Sigma and
    is symmetric and positive by its form.

    Parameters
    ----------
    covariance : ndarray, (6, 6)
        Sigma.
    information : ndarray, (6, 6)
        A, the sum of ``H^T R^-1 H``.

    Returns
    -------
    ndarray, (6, 6)
    """
    variances, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    inner = np.linalg.cholesky(np.eye(len(root)) + root.T @ information @ root)
    half = np.linalg.solve(inner, root.T)
    return half.T @ half
