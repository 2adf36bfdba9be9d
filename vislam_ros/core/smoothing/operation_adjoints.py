# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The way back through propagation, initialization and marginalization.

With ``lambda`` and ``Lambda`` as of after an operation ``delta <- A delta`` they are ``A^T
lambda`` and ``A^T Lambda A`` before it; its noise changes neither.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.linalg.linear_update import diagonal_blocks, mirror_upper
from vislam_ros.core.linalg.scatter import put
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.operations.error_state import ErrorState, PoseMark
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization
from vislam_ros.core.operations.transition import (
    NewBeginning,
    RandomWalk,
    Transition,
    VehicleTransition,
)
from vislam_ros.core.smoothing.adjoint import Adjoint, moved_by

Array = NDArray[np.float64]


class RandomWalkAdjoint:
    """Noise says nothing of what it is added to."""

    def __init__(self, operation: RandomWalk, state: ErrorState):
        state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Return what is said after it as it is."""
        return later


class NewBeginningAdjoint:
    """What is said of a part that began anew says nothing of what it was before."""

    def __init__(self, operation: NewBeginning, state: ErrorState):
        state.apply(operation)
        self._part = operation.part

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the beginning to before it."""
        later.vector[self._part] = 0.0
        later.matrix[self._part] = 0.0
        later.matrix[:, self._part] = 0.0
        return later


class TransitionAdjoint:
    """``lambda <- F^T lambda``, ``Lambda <- F^T Lambda F``."""

    def __init__(self, operation: Transition, state: ErrorState):
        state.apply(operation)
        self._operation = operation

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the motion to before it."""
        vector, half = np.empty_like(later.vector), np.empty_like(later.matrix)
        self._transposed_times(later.vector[:, None], vector[:, None])
        self._transposed_times(later.matrix, half)
        self._transposed_times(half.T, later.matrix)
        mirror_upper(later.matrix)
        return Adjoint(vector, later.matrix)

    def _transposed_times(self, X: Array, result: Array) -> None:
        """Put F^T X into a result (D, c) for X (D, c)."""
        A, D, C = self._operation.vehicle, self._operation.landmarks, self._operation.coupling
        s, columns = len(A), X.shape[1]
        np.matmul(A.T, X[:s], out=result[:s])
        result[6:s] += C.reshape(len(X) - s, s - 6).T @ X[s:]
        blocks = result[s:].reshape(-1, 3, columns)
        np.matmul(np.swapaxes(D, -1, -2), X[s:].reshape(-1, 3, columns), out=blocks)


class VehicleTransitionAdjoint:
    """The same for ``F = blkdiag(A, I)``."""

    def __init__(self, operation: VehicleTransition, state: ErrorState):
        state.apply(operation)
        self._A_T = operation.vehicle.T

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the motion to before it."""
        A_T, s = self._A_T, len(self._A_T)
        vector, matrix = later.vector, later.matrix
        vector[:s] = A_T @ vector[:s]
        matrix[:s, :s] = symmetrized(A_T @ matrix[:s, :s] @ A_T.T)
        matrix[:s, s:] = A_T @ matrix[:s, s:]
        matrix[s:, :s] = matrix[:s, s:].T
        return later


class InitializationAdjoint:
    """Fold with ``[I; J]^T``: what is said of a new landmark is said of what it came from."""

    def __init__(self, operation: Initialization, state: ErrorState):
        self._size, self._s = len(state.covariance), state.vehicle_size
        state.apply(operation)
        self._J = operation.J

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said of the grown error state to that before it had grown."""
        size, s = self._size, self._s
        vector, matrix = later.vector[:size].copy(), later.matrix[:size, :size].copy()
        if self._J is not None:
            J = self._J.reshape(-1, s)
            vector[:s] += J.T @ later.vector[size:]
            cross = J.T @ later.matrix[size:, :size]
            matrix[:s] += cross
            matrix[:, :s] += cross.T
            matrix[:s, :s] += symmetrized(J.T @ later.matrix[size:, size:] @ J)
        return Adjoint(vector, matrix)


class MarginalizationAdjoint:
    """Pad with zeros: nothing later was said of what had left, but by way of the others."""

    def __init__(self, operation: Marginalization, state: ErrorState):
        P, s, m = state.covariance, state.vehicle_size, len(operation.keys)
        leaving = np.zeros(len(P), dtype=bool)
        leaving[state.rows_of(np.flatnonzero(operation.gone))] = True
        self._means, J_vehicle, J_landmark = operation.positions()
        C = P[leaving]
        if J_landmark is not None:
            C = (J_landmark @ C.reshape(m, 3, len(P))).reshape(3 * m, len(P))
        if J_vehicle is not None:
            C = C + J_vehicle.reshape(3 * m, s) @ P[:s]
        own = diagonal_blocks(C[:, leaving], 3)
        if J_landmark is not None:
            own = own @ np.swapaxes(J_landmark, -1, -2)
        if J_vehicle is not None:
            own = own + C[:, :s].reshape(m, 3, s) @ np.swapaxes(J_vehicle, -1, -2)
        self.keys = operation.keys
        self._size, self._stays = len(P), np.flatnonzero(~leaving)
        self._C, self._own = C[:, self._stays], symmetrized(own)
        state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said of the error state to that before the landmarks had left."""
        vector, matrix = np.zeros(self._size), np.zeros((self._size, self._size))
        vector[self._stays] = later.vector
        put(later.matrix, self._stays, self._stays, matrix)
        return Adjoint(vector, matrix)

    def final(self, later: Adjoint) -> tuple[Array, Array]:
        """World positions (m, 3) and covariances (m, 3, 3) after all that came later."""
        moves, covariances = moved_by(later, self._C, self._own)
        return self._means + moves, covariances


class PoseMarkAdjoint:
    """A pose is smoothed as if it had left the error state at its mark."""

    def __init__(self, operation: PoseMark, state: ErrorState):
        self._T_world_body, self._C = operation.T_world_body, state.covariance[:6].copy()
        state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Return what is said after it as it is."""
        return later

    def smoothed(self, later: Adjoint) -> tuple[Array, Array]:
        """Pose (4, 4) and its covariance (6, 6) after all that came later."""
        moves, covariances = moved_by(later, self._C, self._C[None, :, :6])
        return self._T_world_body @ se3.exp(moves[0]), covariances[0]
