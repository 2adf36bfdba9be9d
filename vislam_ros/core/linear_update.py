# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The correction of a Kalman filter, as the few LAPACK calls it needs, in place.

There are two: :func:`correct` for any H, and :func:`correct_directly` where components of the
state are themselves observed. Covariances are C-ordered and symmetric, so the transposed view of
one is itself in the Fortran order that LAPACK works on without a copy.
"""

from typing import Any, cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vislam_ros.core.motion import symmetrized

Array = NDArray[np.float64]
Rows = slice | NDArray[np.int64]
"""Components of the error state; those of a block are both slices or both arrays."""

# Rows of L that are solved for at once. OpenBLAS solves small triangles well and multiplies large
# matrices well; a whole triangle of some hundred rows takes it half as long again.
_BLOCK = 48
# Rows of L that are inverted at once, for the same reason.
_BLOCK_OF_INVERSE = 50

_strictly_lower = np.zeros((0, 0), dtype=bool)


class Scratch:
    """Matrices that are used again in every step.

    Fresh memory of some hundred kB comes from the kernel page by page, which takes longer than
    the arithmetic on it.
    """

    def __init__(self) -> None:
        self._memory: dict[str, Array] = {}

    def matrix(self, name: str, rows: int, columns: int) -> Array:
        """Return the matrix of a name in this size, C-ordered, with anything in it."""
        memory = self._memory.get(name)
        if memory is None or len(memory) < rows * columns:
            # Twice what is asked for: sizes come and go.
            memory = self._memory[name] = np.empty(2 * rows * columns)
        return memory[: rows * columns].reshape(rows, columns)

    def successor(self, P: Array, size: int) -> Array:
        """Return a matrix (size, size) for what comes after P, of two that take turns."""
        name = "second" if P.base is self._memory.get("first") else "first"
        return self.matrix(name, size, size)


def without(P: Array, kept: NDArray[np.int64], scratch: Scratch) -> Array:
    """Covariance (k, k) of some components of an error state."""
    rows = scratch.matrix("work", len(kept), len(P))
    np.take(P, kept, axis=0, out=rows, mode="clip")
    rest = scratch.successor(P, len(kept))
    return np.take(rows, kept, axis=1, out=rest, mode="clip")


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
    L = _lower_factor(S)
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


def inverse_of_positive(S: Array, out: Array | None = None) -> Array:
    """Inverse (m, m) of a positive matrix, symmetric to the last bit.

    Parameters
    ----------
    S : ndarray, (m, m)
        C-ordered; is overwritten.
    out : ndarray, (m, m), optional
        C-ordered; where to put the inverse.

    Raises
    ------
    scipy.linalg.LinAlgError
        Where S is not positive.
    """
    m = len(S)
    if not m:
        return S
    L = _lower_factor(S)
    # Z = L^-1, by rows of blocks: Z_ij = -L_ii^-1 (L_i0 Z_0j + ... + L_i,i-1 Z_i-1,j).
    Z = np.empty((m, m)) if out is None else out
    Z[:] = 0.0
    for begin in range(0, m, _BLOCK_OF_INVERSE):
        end = min(begin + _BLOCK_OF_INVERSE, m)
        own, _ = lapack.dtrtri(np.tril(L[begin:end, begin:end]), lower=1)
        Z[begin:end, begin:end] = own
        if begin:
            solved = -own @ L[begin:end, :begin]
            np.matmul(solved, Z[:begin, :begin], out=Z[begin:end, :begin])
    # S^-1 = Z^T Z; what LAPACK takes for its upper triangle is C-ordered Z's lower one.
    product, _ = lapack.dlauum(Z.T, lower=0, overwrite_c=1)
    W = product.T
    mirror_lower(W)
    return W


def correct_directly(
    P: Array,
    seen: Rows,
    rest: Rows,
    noise: Array,
    S_inverse: Array,
) -> Array:
    """Correct a covariance in place by observations of components of the state, ``H = [0 I]``.

    With ``S = P_LL + R`` the gain of what is seen is ``P_LL S^-1 = I - R S^-1``, so that all is
    had from the inverse without another product of its size::

        P_LL <- R - R S^-1 R,   P_xL <- P_xL S^-1 R,   P_xx <- P_xx - P_xL S^-1 P_Lx

    Parameters
    ----------
    P : ndarray, (D, D)
        Covariance; becomes that after the correction.
    seen : slice or ndarray of int64, (m,)
        Which components are observed.
    rest : slice or ndarray of int64, (D - m,)
        All others.
    noise : ndarray, (m,)
        Variances R of the observations, which are independent.
    S_inverse : ndarray, (m, m)
        Symmetric.

    Returns
    -------
    ndarray, (D - m, m)
        P_xL as it was.
    """
    cross = P[block(rest, seen)].copy()
    gain = cross @ S_inverse
    P[block(rest, rest)] = symmetrized(P[block(rest, rest)] - gain @ cross.T)
    mixed = gain * noise
    P[block(rest, seen)] = mixed
    P[block(seen, rest)] = mixed.T
    view = isinstance(seen, slice)
    P_LL = np.multiply(S_inverse, noise, out=P[seen, seen] if view else None)
    P_LL *= -noise[:, None]
    np.einsum("ii->i", P_LL)[:] += noise
    if not view:
        P[block(seen, seen)] = P_LL
    return cross


def mirror_upper(P: Array) -> None:
    """Make a matrix (D, D) symmetric in place by its upper triangle."""
    np.copyto(P, P.T, where=_below_the_diagonal(len(P)))


def mirror_lower(P: Array) -> None:
    """Make a matrix (D, D) symmetric in place by its lower triangle."""
    np.copyto(P.T, P, where=_below_the_diagonal(len(P)))


def _below_the_diagonal(size: int) -> NDArray[np.bool_]:
    global _strictly_lower
    if len(_strictly_lower) < size:
        _strictly_lower = np.tri(2 * size, k=-1, dtype=bool)
    return _strictly_lower[:size, :size]


def block(rows: Rows, columns: Rows) -> Any:
    """Index of a block of a matrix: a view of it where rows and columns are slices."""
    if isinstance(rows, slice) or isinstance(columns, slice):
        return rows, columns
    return np.ix_(rows, columns)


def diagonal_blocks(matrix: Array, r: int) -> Array:
    """Copies (n, r, r) of the blocks on the diagonal of a matrix (n r, n r)."""
    rows = np.arange(len(matrix)).reshape(-1, r)
    return matrix[rows[:, :, None], rows[:, None, :]]


def _lower_factor(S: Array) -> Array:
    """Cholesky factor L (m, m) in its lower triangle, made in the place of a C-ordered S."""
    L, failed_at = lapack.dpotrf(S.T, lower=1, clean=0, overwrite_a=1)
    if failed_at:
        raise scipy.linalg.LinAlgError(f"S is not positive at its row {failed_at}")
    return cast(Array, L)
