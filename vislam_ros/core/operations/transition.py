# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Propagation of the error state: ``P <- F P F^T + Q``, the report's eq. 28, 34 and 65-67.

Q is a :class:`RandomWalk` of the vehicle state. F is a :class:`VehicleTransition` where landmarks
stay as they are, in the world, a :class:`Transition` where they move with the camera, and a
:class:`NewBeginning` where a part of the vehicle state begins anew.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.linear_update import mirror_lower
from vislam_ros.core.operations.error_state import ErrorState, Operation

Array = NDArray[np.float64]

# Of a symmetric product only the lower triangle is worked out, but for so many rows at once.
_ROWS_AT_ONCE = 64


@dataclass(frozen=True)
class RandomWalk(Operation[None]):
    """The vehicle state takes a random step: ``P_vv <- P_vv + Q`` (eq. 67).

    Attributes
    ----------
    noise : ndarray, (s, s)
        Q.
    """

    noise: Array

    def forward(self, state: ErrorState) -> None:
        """Add the noise."""
        P_vv = state.vehicle_covariance
        P_vv += self.noise


@dataclass(frozen=True)
class NewBeginning(Operation[None]):
    """A part of the vehicle state begins anew, at a value that is known: F is zero there.

    Attributes
    ----------
    part : slice
    """

    part: slice

    def forward(self, state: ErrorState) -> None:
        """Leave no error in it."""
        P = state.covariance
        P[self.part] = 0.0
        P[:, self.part] = 0.0


@dataclass(frozen=True)
class VehicleTransition(Operation[None]):
    """Motion past landmarks that stay: ``F = blkdiag(A, I)`` (eq. 66).

    Attributes
    ----------
    vehicle : ndarray, (s, s)
        A.
    """

    vehicle: Array

    def forward(self, state: ErrorState) -> None:
        """``P_vv <- A P_vv A^T`` and ``P_vL <- A P_vL``."""
        A, P, s = self.vehicle, state.covariance, state.vehicle_size
        P[:s, :s] = A @ P[:s, :s] @ A.T
        P[:s, s:] = A @ P[:s, s:]
        P[s:, :s] = P[:s, s:].T


@dataclass(frozen=True)
class Transition(Operation[None]):
    """Motion that landmarks take part in: ``F = [[A, 0], [C, D]]``, D block-diagonal.

    Attributes
    ----------
    vehicle : ndarray, (s, s)
        A.
    landmarks : ndarray, (n, 3, 3)
        Blocks of D.
    coupling : ndarray, (n, 3, s - 6)
        C: how the landmarks depend on what follows the pose in the vehicle state, for no motion of
        the camera's own frame depends on where that lies.
    """

    vehicle: Array
    landmarks: Array
    coupling: Array

    def moved(self, rows: slice, delta: Array) -> Array:
        """What an error (k,) of some of the vehicle's rows behind the pose becomes (D,)."""
        coupled = self.coupling[:, :, rows.start - 6 : rows.stop - 6] @ delta
        return np.concatenate([self.vehicle[:, rows] @ delta, coupled.ravel()])

    def forward(self, state: ErrorState) -> None:
        """``P <- F (P - Y^T Y) F^T``: a correction just before it costs less along with it."""
        A, D, s = self.vehicle, self.landmarks, state.vehicle_size
        P, Y = state.take_downdate()
        m = len(P) - s
        P_vv, P_vL, left, right = _moved_with_vehicle(P, s, Y, D, self.coupling)
        rest = state.scratch.matrix("work", m, m)
        for begin in range(0, m, _ROWS_AT_ONCE):
            end = min(begin + _ROWS_AT_ONCE, m)
            np.matmul(left[:, begin:end].T, right[:, :end], out=rest[begin:end, :end])
        _move_landmarks(P, s, D, rest)
        P[:s, :s] = A @ P_vv @ A.T
        mirror_lower(P[:s, :s])
        P[:s, s:] = A @ P_vL
        P[s:, :s] = P[:s, s:].T


@compiled("void(float64[:, :], float64[:, :, ::1], float64[:, :])")
def _times_transposed(X: Array, D: Array, out: Array) -> None:
    """Put ``X D^T`` (k, 3 n) into a matrix, for X (k, 3 n) and D of blocks (n, 3, 3)."""
    for i in range(len(X)):
        for j in range(len(D)):
            x, y, z = X[i, 3 * j], X[i, 3 * j + 1], X[i, 3 * j + 2]
            for r in range(3):
                out[i, 3 * j + r] = D[j, r, 0] * x + D[j, r, 1] * y + D[j, r, 2] * z


@compiled(
    "UniTuple(float64[:, ::1], 4)"
    "(float64[:, ::1], int64, float64[:, ::1], float64[:, :, ::1], float64[:, :, ::1])"
)
def _moved_with_vehicle(
    P: Array, s: int, Y: Array, D: Array, C: Array
) -> tuple[Array, Array, Array, Array]:
    """Move by D (n, 3, 3) and C (n, 3, s - 6) what P - Y^T Y holds of the vehicle state.

    Returns
    -------
    P_vv : ndarray, (s, s)
        As it was.
    P_vL : ndarray, (s, 3 n)
        ``P_vL D^T + P_vv C^T``.
    left, right : ndarray, (k, 3 n)
        ``C P_vv C^T + C P_vL D^T + D P_Lv C^T - D Y_L^T Y_L D^T`` is ``left^T right``.
    """
    m, k_Y = 3 * len(D), len(Y)
    rows = P[:s].copy()
    for i in range(s):
        for k in range(k_Y):
            for j in range(len(P)):
                rows[i, j] -= Y[k, i] * Y[k, j]
    # Few columns of C are not zero: the bias shows in nothing but the twist's measurement.
    used = [c for c in range(s - 6) if np.any(C[:, :, c])]
    r = len(used)
    left, right = np.empty((2 * r + k_Y, m)), np.empty((2 * r + k_Y, m))
    _times_transposed(Y[:, s:], D, right[2 * r :])
    P_vL = np.empty((s, m))
    _times_transposed(rows[:, s:], D, P_vL)
    for k in range(r):
        left[k] = P_vL[6 + used[k]]
        for i in range(len(C)):
            for c in range(3):
                left[r + k, 3 * i + c] = right[k, 3 * i + c] = C[i, c, used[k]]
    for k in range(2 * r, 2 * r + k_Y):
        for j in range(m):
            left[k, j] = -right[k, j]
    for i in range(s):
        for k in range(r):
            for j in range(m):
                P_vL[i, j] += rows[i, 6 + used[k]] * right[k, j]
    for k in range(r):
        # Half of C P_vv C^T on each side.
        for j in range(m):
            left[k, j] = 0.5 * (left[k, j] + P_vL[6 + used[k], j])
            right[r + k, j] = left[k, j]
    return rows[:, :s].copy(), P_vL, left, right


@compiled("void(float64[:, ::1], int64, float64[:, :, ::1], float64[:, ::1])")
def _move_landmarks(P: Array, s: int, D: Array, rest: Array) -> None:
    """``P_LL <- D P_LL D^T + rest`` by the lower triangle, for D of blocks (n, 3, 3)."""
    P_LL, half = P[s:, s:], np.empty((3, 3 * len(D)))
    for i in range(len(D)):
        own = P_LL[3 * i : 3 * i + 3]
        for r in range(3):
            for k in range(3 * i + 3):
                half[r, k] = (
                    D[i, r, 0] * own[0, k] + D[i, r, 1] * own[1, k] + D[i, r, 2] * own[2, k]
                )
        for r in range(3):
            row = 3 * i + r
            for j in range(i + 1):
                x, y, z = half[r, 3 * j], half[r, 3 * j + 1], half[r, 3 * j + 2]
                for c in range(3):
                    moved = rest[row, 3 * j + c]
                    moved += D[j, c, 0] * x + D[j, c, 1] * y + D[j, c, 2] * z
                    own[r, 3 * j + c] = P_LL[3 * j + c, row] = moved
