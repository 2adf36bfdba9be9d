# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Corrections of the error state by what depends on the vehicle state and on landmarks.

The report's ``K = P H^T S^-1`` with ``S = H P H^T + R`` (eq. 22, 36, 69 and 73) and ``P <- (I - K
H) P`` (eq. 24, 35 and 71), as ``P - Y^T Y`` with ``S = L L^T`` and ``Y = L^-1 H P``. The estimate
moves by ``K r`` (eq. 23 and 70), the pose on its right: ``T <- T Exp(delta)``. From then on the
error is one about the new pose. The Jacobian of that change is the identity to first order, and
the identity is what the filter takes it for; so does the backward pass, which makes the smoothed
estimates those of the filter's own linear system, to rounding.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.linear_update import (
    Corrected,
    correct,
    diagonal_blocks,
    spread,
    take,
    whitened,
)
from vislam_ros.core.linalg.scratch import Scratch
from vislam_ros.core.operations.error_state import ErrorState, Operation

Array = NDArray[np.float64]


class Innovation(NamedTuple):
    """What a gate and a correction both need of n groups of r rows.

    Attributes
    ----------
    HP : ndarray, (n r, D)
    S : ndarray, (n r, n r)
        ``H P H^T + R``.
    r : int
    """

    HP: Array
    S: Array
    r: int

    def covariances(self) -> Array:
        """Covariance (n, r, r) of each group's innovation."""
        return diagonal_blocks(self.S, self.r)

    def of(self, groups: NDArray[np.bool_], scratch: Scratch) -> "Innovation":
        """Return that of some groups (n,)."""
        rows, columns = np.flatnonzero(np.repeat(groups, self.r)), np.arange(self.HP.shape[1])
        HP = scratch.matrix("HP of some", len(rows), len(columns))
        S = scratch.matrix("S of some", len(rows), len(rows))
        take(self.HP, rows, columns, HP)
        take(self.S, rows, rows, S)
        return Innovation(HP, S, self.r)


@dataclass(frozen=True)
class Correction(Operation[Corrected]):
    """Correction by landmarks, of each of which r rows are seen with independent noise.

    Attributes
    ----------
    residual : ndarray, (n, r)
        ``z - h``.
    noise : ndarray, (r, r)
        R of each.
    H_vehicle : ndarray, (n, r, s)
    H_landmark : ndarray, (n, r, 3)
    slots : ndarray of int64, (n,)
        Which landmark each group sees, all different.
    innovation : Innovation, optional
        Where a gate has worked it out already; the correction is made in its place.
    """

    residual: Array
    noise: Array
    H_vehicle: Array
    H_landmark: Array
    slots: NDArray[np.int64]
    innovation: Innovation | None = None

    def innovation_in(self, state: ErrorState) -> Innovation:
        """Work out H P and S without multiplying by the zeros of H."""
        P, s, scratch = state.covariance, state.vehicle_size, state.scratch
        (n, r), D = self.residual.shape, len(P)
        rows = state.rows_of(self.slots).ravel()
        HP, S = scratch.matrix("HP", n * r, D), scratch.matrix("S", n * r, n * r)
        P_L, work = scratch.matrix("P_L", 3 * n, D), scratch.matrix("work", n * r, D)
        take(P, rows, np.arange(D), P_L)
        np.matmul(self.H_vehicle, P[:s], out=HP.reshape(n, r, D))
        np.matmul(self.H_landmark, P_L.reshape(n, 3, D), out=work.reshape(n, r, D))
        HP += work
        columns = HP.T[rows].reshape(n, 3, n * r)
        np.matmul(self.H_landmark, columns, out=S.reshape(n, r, n * r))
        S += self.H_vehicle.reshape(n * r, s) @ HP.T[:s]
        blocks = S.reshape(n, r, n, r)
        blocks[np.arange(n), :, np.arange(n), :] += self.noise
        return Innovation(HP, S, r)

    def by(self, inliers: NDArray[np.bool_], innovation: Innovation) -> "Correction":
        """Return the correction by some (n,) of these landmarks, given their innovation."""
        return Correction(
            self.residual[inliers],
            self.noise,
            self.H_vehicle[inliers],
            self.H_landmark[inliers],
            self.slots[inliers],
            innovation,
        )

    def forward(self, state: ErrorState) -> Corrected:
        """``P <- P - Y^T Y``."""
        innovation = self.innovation or self.innovation_in(state)
        return correct(state.covariance, innovation.S, innovation.HP, self.residual.ravel())

    def recorded(self) -> "Correction":
        """All but the innovation, which is large and can be worked out again."""
        return replace(self, innovation=None)


@dataclass(frozen=True)
class VehicleCorrection(Operation[Corrected]):
    """Correction by a few numbers that depend on the vehicle state alone.

    Attributes
    ----------
    residual : ndarray, (r,)
        ``z - h``.
    noise : ndarray, (r,)
        Variances R.
    H : ndarray, (r, s)
        With few entries that are not zero.
    """

    residual: Array
    noise: Array
    H: Array

    def expected(self, covariance: Array) -> Array:
        """Variances (r,) of the residual where the vehicle state has such a covariance (s, s)."""
        return spread(self.H, covariance) + self.noise

    def forward(self, state: ErrorState) -> Corrected:
        """``P <- P - Y^T Y``, of a rank so low that the next operation may do it in passing."""
        Y, white, L = whitened(state.covariance, self.H, self.noise, self.residual)
        state.defer_downdate(Y)
        return Corrected(white @ Y, white, Y, L)
