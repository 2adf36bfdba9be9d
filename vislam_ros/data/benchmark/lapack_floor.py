# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The floor under an update: the bare LAPACK and BLAS calls without which it cannot be done.

For r rows of observations and an error state of D components::

    potrf   S = L L^T             r^3 / 3 operations
    trsm    Y = L^-1 (H P)        r^2 D
    syrk    P <- P - Y^T Y        r D^2, one triangle

in column order, in place, on buffers that exist. Left out is whatever else a step must do: H and
H P, the motion, gates, admission, retirement and mirroring the triangle.

Where every landmark in the state is seen and its observation is its state, as in disparity space,
P_yy - P_yy S^-1 P_yy = R - R S^-1 R, so the inverse of S (potrf and potri, r^3 together) takes
the place of all three. That is the lower floor.
"""

import time

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

Array = NDArray[np.float64]


class LapackFloor:
    """The calls for one size of update.

    Parameters
    ----------
    rows : int
        Rows r of all observations together.
    size : int
        Size D of the error state.
    """

    def __init__(self, rows: int, size: int):
        rng = np.random.default_rng(0)
        A = rng.standard_normal((size, size))
        P = A @ A.T / size + np.eye(size)
        H = rng.standard_normal((rows, size)) / np.sqrt(size)
        self._P = np.asfortranarray(P)
        self._HP = np.asfortranarray(H @ P)
        self._S = np.asfortranarray(H @ P @ H.T + np.eye(rows))
        self._buffers = [np.copy(M, order="F") for M in (self._S, self._HP, self._P)]

    def __call__(self) -> float:
        """Make the three calls; return the seconds they took."""
        S, HP, P = self._fresh_buffers()
        begin = time.perf_counter()
        L, _ = lapack.dpotrf(S, lower=1, clean=0, overwrite_a=1)
        Y = blas.dtrsm(1.0, L, HP, lower=1, overwrite_b=1)
        blas.dsyrk(-1.0, Y, beta=1.0, c=P, trans=1, lower=1, overwrite_c=1)
        return time.perf_counter() - begin

    def inverse(self) -> float:
        """Make the two calls of the lower floor; return the seconds they took."""
        S, _, _ = self._fresh_buffers()
        begin = time.perf_counter()
        L, _ = lapack.dpotrf(S, lower=1, clean=0, overwrite_a=1)
        lapack.dpotri(L, lower=1, overwrite_c=1)
        return time.perf_counter() - begin

    def _fresh_buffers(self) -> list[Array]:
        for buffer, original in zip(self._buffers, (self._S, self._HP, self._P), strict=True):
            buffer[:] = original
        return self._buffers
