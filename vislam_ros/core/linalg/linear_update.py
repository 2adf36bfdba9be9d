# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The correction of a Kalman filter, as the few LAPACK calls it needs, in place.

The report's ``K = P H^T S^-1``, ``S = H P H^T + R`` and ``(I - K H) P`` (eq. 7-9, 22-24, 35-36 and
69-71), without forming K, and in forms that stay symmetric and positive.

There are two: :func:`correct` for any H, and :func:`correct_directly` where components of the
state are themselves observed. Covariances are C-ordered and symmetric, so the transposed view of
one is itself in the Fortran order that LAPACK works on without a copy.
"""

from typing import NamedTuple, cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.scratch import Scratch

Array = NDArray[np.float64]

# Rows of L that are solved for at once. OpenBLAS solves small triangles well and multiplies large
# matrices well; a whole triangle of some hundred rows takes it half as long again.
_BLOCK = 48
# A triangle of no more rows is inverted at once, for the same reason.
_SMALL_TRIANGLE = 48


def marginal(P: Array, rows: NDArray[np.int64], scratch: Scratch) -> Array:
    """Covariance (k, k) of some components of an error state, the others left out."""
    rest = scratch.successor(P, len(rows))
    take(P, rows, rows, rest)
    return rest


def spread(H: Array, P: Array) -> Array:
    """Diagonal (r,) of ``H P H^T``: variances of what depends so on errors of covariance P."""
    return np.asarray(np.sum((H @ P) * H, axis=1))


class Corrected(NamedTuple):
    """What a correction has found, with ``S = L L^T``.

    Attributes
    ----------
    delta : ndarray, (D,)
        ``K r``, what the state is to be moved by.
    whitened : ndarray, (m,)
        ``L^-1 r``.
    Y : ndarray, (m, D)
        ``L^-1 H P``.
    L : ndarray, (m, m)
        In its lower triangle; above it there may be anything.
    """

    delta: Array
    whitened: Array
    Y: Array
    L: Array

    @property
    def nis(self) -> float:
        """``r^T S^-1 r``."""
        return float(self.whitened @ self.whitened)


def correct(P: Array, S: Array, HP: Array, residual: Array) -> Corrected:
    """Correct a covariance in place.

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
    downdate(P, Y_T)
    return Corrected(Y_T @ whitened, whitened, Y_T.T, L)


def downdate(P: Array, Y_T: Array) -> None:
    """``P <- P - Y^T Y`` in place, symmetric to the last bit.

    Parameters
    ----------
    P : ndarray, (D, D)
        Symmetric, C-ordered.
    Y_T : ndarray, (D, m)
        In Fortran order, or it is copied.
    """
    blas.dsyrk(-1.0, Y_T, beta=1.0, c=P.T, lower=1, overwrite_c=1)
    mirror_upper(P)


def inverse_of_positive(S: Array) -> Array:
    """Inverse (m, m) of a positive matrix, in its place, symmetric to the last bit.

    It goes by way of L: by halves, with Schur's complements, it would be faster by an eighth, and
    not positive where what is known differs by ten orders of magnitude, as before the motion is.

    Parameters
    ----------
    S : ndarray, (m, m)
        C-ordered; becomes its inverse.

    Raises
    ------
    scipy.linalg.LinAlgError
        Where S is not positive.
    """
    if not len(S):
        return S
    L = _lower_factor(S)
    _invert_lower(L)
    # S^-1 = Z^T Z.
    product, _ = lapack.dlauum(L, lower=1, overwrite_c=1)
    mirror_lower(product)
    return cast(Array, product.T)


def _invert_lower(L: Array) -> None:
    """``Z = L^-1`` in the place of a lower triangle (m, m): ``Z_21 = -Z_22 L_21 Z_11`` of halves.

    LAPACK's own takes twice as long where m is a few hundred.
    """
    if len(L) <= _SMALL_TRIANGLE:
        L[:], _ = lapack.dtrtri(L, lower=1)
        return
    half = len(L) // 2
    first, second, below = L[:half, :half], L[half:, half:], L[half:, :half]
    _invert_lower(first)
    _invert_lower(second)
    product = blas.dtrmm(-1.0, second, below, lower=1)
    below[:] = blas.dtrmm(1.0, first, product, side=1, lower=1, overwrite_b=1)


@compiled(
    "Tuple((float64[:, ::1], float64[::1], float64[:, ::1]))"
    "(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])"
)
def whitened(P: Array, H: Array, noise: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Whiten a few rows of observations of the first components of the state.

    With ``S = H P H^T + R = L L^T`` the correction takes ``Y^T Y`` from P and adds ``Y^T L^-1 r``
    to the state, where ``Y = L^-1 H P``.

    Parameters
    ----------
    P : ndarray, (D, D)
    H : ndarray, (r, s)
        With few entries that are not zero.
    noise : ndarray, (r,)
        Variances R.
    residual : ndarray, (r,)

    Returns
    -------
    Y : ndarray, (r, D)
    whitened_residual : ndarray, (r,)
        ``L^-1 r``.
    L : ndarray, (r, r)

    Raises
    ------
    numpy.linalg.LinAlgError
        Where S is not positive.
    """
    r, s = H.shape
    Y, white = np.zeros((r, len(P))), residual.copy()
    for i in range(r):
        for k in range(s):
            if H[i, k] != 0.0:
                for j in range(len(P)):
                    Y[i, j] += H[i, k] * P[k, j]
    L = np.zeros((r, r))
    for i in range(r):
        L[i, i] = noise[i]
        for j in range(i + 1):
            for k in range(s):
                L[i, j] += Y[i, k] * H[j, k]
    for i in range(r):
        for k in range(i):
            for j in range(k):
                L[i, k] -= L[i, j] * L[k, j]
            L[i, k] /= L[k, k]
            L[i, i] -= L[i, k] * L[i, k]
            white[i] -= L[i, k] * white[k]
            for j in range(len(P)):
                Y[i, j] -= L[i, k] * Y[k, j]
        if not L[i, i] > 0.0:
            raise np.linalg.LinAlgError("S is not positive")
        L[i, i] = np.sqrt(L[i, i])
        white[i] /= L[i, i]
        for j in range(len(P)):
            Y[i, j] /= L[i, i]
    return Y, white, L


def correct_directly(
    P: Array,
    seen: NDArray[np.int64],
    rest: NDArray[np.int64],
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
    seen : ndarray of int64, (m,)
        Which components are observed.
    rest : ndarray of int64, (D - m,)
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
    cross = np.empty((len(rest), len(seen)))
    take(P, rest, seen, cross)
    gain = cross @ S_inverse
    _put_corrected(P, seen, rest, noise, S_inverse, gain, gain @ cross.T)
    return cross


@compiled("int64[::1](int64[::1])")
def _runs(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where runs of places that follow each other begin, and the end of the last one.

    Mostly there is one run or a few: copying them whole takes half the time of place by place.
    """
    bounds = [k for k in range(len(places)) if k == 0 or places[k] != places[k - 1] + 1]
    bounds.append(len(places))
    return np.array(bounds)


@compiled("void(float64[::1], float64[::1])")
def _copy(numbers: Array, into: Array) -> None:
    for j in range(len(numbers)):
        into[j] = numbers[j]


@compiled("void(float64[:, ::1], int64[::1], int64[::1], float64[:, ::1])")
def take(P: Array, rows: NDArray[np.int64], columns: NDArray[np.int64], out: Array) -> None:
    """Copy some rows (k,) and columns (m,) of a matrix into one of their own (k, m)."""
    runs = _runs(columns)
    for i in range(len(rows)):
        for k in range(len(runs) - 1):
            first, length = columns[runs[k]], runs[k + 1] - runs[k]
            _copy(P[rows[i], first : first + length], out[i, runs[k] : runs[k + 1]])


def keep_in_place(P: Array, rows: NDArray[np.int64]) -> Array:
    """Keep some rows (k,), ascending, and the same columns of a matrix, in its own memory."""
    _move_together(P.reshape(-1), len(P), rows)
    return P.reshape(-1)[: len(rows) ** 2].reshape(len(rows), len(rows))


@compiled("void(float64[::1], int64, int64[::1])")
def _move_together(numbers: Array, size: int, rows: NDArray[np.int64]) -> None:
    # Each number goes to where it was read, or before it: nothing is read after it is overwritten.
    k = len(rows)
    for i in range(k):
        for j in range(k):
            numbers[i * k + j] = numbers[rows[i] * size + rows[j]]


@compiled(
    "void(float64[:, ::1], int64[::1], int64[::1], float64[::1], float64[:, ::1],"
    " float64[:, ::1], float64[:, ::1])"
)
def _put_corrected(
    P: Array,
    seen: NDArray[np.int64],
    rest: NDArray[np.int64],
    noise: Array,
    S_inverse: Array,
    gain: Array,
    change: Array,
) -> None:
    """Put the corrected blocks into P, with the gain P_xL S^-1 and the change gain P_Lx."""
    m, runs = len(seen), _runs(seen)
    row = np.empty(m)
    for i in range(m):
        for j in range(m):
            row[j] = -noise[i] * (S_inverse[i, j] * noise[j])
        row[i] += noise[i]
        for k in range(len(runs) - 1):
            first, length = seen[runs[k]], runs[k + 1] - runs[k]
            _copy(row[runs[k] : runs[k + 1]], P[seen[i], first : first + length])
        for j in range(len(rest)):
            mixed = gain[j, i] * noise[i]
            P[seen[i], rest[j]] = mixed
            P[rest[j], seen[i]] = mixed
    for i in range(len(rest)):
        for j in range(i + 1):
            own = P[rest[i], rest[j]] + P[rest[j], rest[i]] - change[i, j] - change[j, i]
            P[rest[i], rest[j]] = P[rest[j], rest[i]] = 0.5 * own


@compiled("void(float64[:, ::1], int64[::1], float64[::1], float64[:, ::1])")
def innovation_covariance(P: Array, seen: NDArray[np.int64], noise: Array, out: Array) -> None:
    """Put ``S = P_LL + R`` into a matrix (m, m), named as in :func:`correct_directly`."""
    take(P, seen, seen, out)
    for i in range(len(seen)):
        out[i, i] += noise[i]


@compiled("void(float64[:, :])")
def mirror_lower(P: Array) -> None:
    """Make a matrix (D, D) symmetric in place by its lower triangle."""
    for i in range(len(P)):
        for j in range(i):
            P[j, i] = P[i, j]


def mirror_upper(P: Array) -> None:
    """Make a matrix (D, D) symmetric in place by its upper triangle."""
    mirror_lower(P.T)


@compiled("float64[:, :, ::1](float64[:, :], int64)")
def diagonal_blocks(matrix: Array, r: int) -> Array:
    """Copies (n, r, r) of the blocks on the diagonal of a matrix (n r, n r)."""
    n = len(matrix) // r
    blocks = np.empty((n, r, r))
    for k in range(n):
        for i in range(r):
            for j in range(r):
                blocks[k, i, j] = matrix[k * r + i, k * r + j]
    return blocks


def _lower_factor(S: Array) -> Array:
    """Cholesky factor L (m, m) in its lower triangle, made in the place of a C-ordered S."""
    L, failed_at = lapack.dpotrf(S.T, lower=1, clean=0, overwrite_a=1)
    if failed_at:
        raise scipy.linalg.LinAlgError(f"S is not positive at its row {failed_at}")
    return cast(Array, L)
