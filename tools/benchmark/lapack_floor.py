# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The floor under an update: the bare LAPACK and BLAS calls without which it cannot be done.

For r rows of observations and an error state of D components::

    potrf   S = L L^T             r^3 / 3 operations
    trsm    Y^T = (H P)^T L^-T    r^2 D
    syrk    P <- P - Y^T Y        r D^2, one triangle

in column order, in place, on buffers that exist, in the order of the three that is fastest here.
Left out is whatever else a step must do: the motion, H P, gates, admission, retirement, and the
other triangle.

In disparity space the motion moves every landmark, so ``F P F^T`` is bare work, too: a small
matrix product for each landmark, twice. It is measured apart.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from benchmark.interleaving import cpu_clock

Array = NDArray[np.float64]


class LapackFloor:
    """The calls for one size of update.

    Parameters
    ----------
    rows : int
        Rows r of all observations together, three for each landmark.
    size : int
        Size D of the error state.
    """

    def __init__(self, rows: int, size: int):
        rng = np.random.default_rng(0)
        A = rng.standard_normal((size, size))
        P = A @ A.T / size + np.eye(size)
        H = rng.standard_normal((rows, size)) / np.sqrt(size)
        self._P = np.asfortranarray(P)
        self._HP_T = np.asfortranarray(P @ H.T)
        self._S = np.asfortranarray(H @ P @ H.T + np.eye(rows))
        landmarks = rows // 3
        vehicle = size - rows
        self._vehicle = np.eye(vehicle)
        self._landmarks = np.tile(np.eye(3), (landmarks, 1, 1))
        self._coupling = np.zeros((rows, vehicle))
        self._half, self._whole = np.empty((size, size)), np.empty((size, size))
        self._buffers = [np.copy(M, order="F") for M in (self._S, self._HP_T, self._P)]

    def __call__(self) -> float:
        """Make the three calls; return the seconds they took."""
        S, HP_T, P = self._fresh_buffers()
        begin = cpu_clock()
        L, _ = lapack.dpotrf(S, lower=1, clean=0, overwrite_a=1)
        Y_T = blas.dtrsm(1.0, L, HP_T, side=1, lower=1, trans_a=1, overwrite_b=1)
        blas.dsyrk(-1.0, Y_T, beta=1.0, c=P, lower=1, overwrite_c=1)
        return cpu_clock() - begin

    def motion(self) -> float:
        """Multiply by F from both sides; return the seconds it took."""
        vehicle, landmarks = self._vehicle, self._landmarks
        P, half, whole = self._P, self._half, self._whole
        begin = cpu_clock()
        for source, target in ((P, half), (half.T, whole)):
            n, s = len(landmarks), len(vehicle)
            np.matmul(vehicle, source[:s], out=target[:s])
            blocks = target[s:].reshape(n, 3, -1)
            np.matmul(landmarks, source[s:].reshape(n, 3, -1), out=blocks)
            target[s:] += self._coupling @ source[:s]
        return cpu_clock() - begin

    def _fresh_buffers(self) -> list[Array]:
        for buffer, original in zip(self._buffers, (self._S, self._HP_T, self._P), strict=True):
            buffer[:] = original
        return self._buffers
