# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The correction of a Kalman filter, as the few LAPACK calls it needs, in place.

Covariances are C-ordered and symmetric, so the transposed view of one is itself in the Fortran
order that LAPACK works on without a copy.
"""

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

Array = NDArray[np.float64]

# Rows of L that are solved for at once. OpenBLAS solves small triangles well and multiplies large
# matrices well; a whole triangle of some hundred rows takes it half as long again.
_BLOCK = 48

_strictly_lower = np.zeros((0, 0), dtype=bool)


def correct(P: Array, S: Array, HP: Array, residual: Array) -> tuple[Array, float]:
    """Correct a covariance in place and return what the state is to be moved by.

    With ``S = L L^T`` and ``Y = L^-1 H P``, ``P - K S K^T`` is ``P - Y^T Y``: symmetric to the
    last bit, unlike ``(I - K H) P``.

    Parameters
    ----------
    P : ndarray, (D, D)
        Covariance, C-ordered; becomes that after the correction.
    S : ndarray, (m, m)
        Covariance of the residual, C-ordered; is overwritten.
    HP : ndarray, (m, D)
        C-ordered; is overwritten.
    residual : ndarray, (m,)

    Returns
    -------
    delta : ndarray, (D,)
        ``K r``.
    nis : float
        ``r^T S^-1 r``.

    Raises
    ------
    scipy.linalg.LinAlgError
        Where S is not positive; P is as it was.
    """
    L, failed_at = lapack.dpotrf(S.T, lower=1, clean=0, overwrite_a=1)
    if failed_at:
        raise scipy.linalg.LinAlgError(f"S is not positive at its row {failed_at}")
    whitened = blas.dtrsv(L, residual, lower=1)
    # Y^T L^T = (H P)^T, some columns of Y^T at a time.
    Y_T = HP.T
    for begin in range(0, len(S), _BLOCK):
        end = min(begin + _BLOCK, len(S))
        if begin:
            blas.dgemm(
                -1.0,
                Y_T[:, :begin],
                L[begin:end, :begin],
                beta=1.0,
                c=Y_T[:, begin:end],
                trans_b=1,
                overwrite_c=1,
            )
        blas.dtrsm(
            1.0,
            L[begin:end, begin:end],
            Y_T[:, begin:end],
            side=1,
            lower=1,
            trans_a=1,
            overwrite_b=1,
        )
    blas.dsyrk(-1.0, Y_T, beta=1.0, c=P.T, lower=1, overwrite_c=1)
    mirror_upper(P)
    return Y_T @ whitened, float(whitened @ whitened)


def mirror_upper(P: Array) -> None:
    """Make a matrix (D, D) symmetric in place by its upper triangle."""
    global _strictly_lower
    size = len(P)
    if len(_strictly_lower) < size:
        _strictly_lower = np.tri(2 * size, k=-1, dtype=bool)
    np.copyto(P, P.T, where=_strictly_lower[:size, :size])
