# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The way back through corrections.

``lambda <- H^T S^-1 r + (I - K H)^T lambda`` and ``Lambda <- H^T S^-1 H + (I - K H)^T Lambda (I -
K H)``, as sums of squares: forms with fewer products exist, but subtract, and lose the sign of
Lambda's small eigenvalues.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vislam_ros.core.linalg.linear_update import Corrected, mirror_upper, take
from vislam_ros.core.linalg.scatter import put, put_both
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.operations.correction import Correction, VehicleCorrection
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.smoothing.adjoint import Adjoint

Array = NDArray[np.float64]


class CorrectionAdjoint:
    """The way back through a correction by landmarks."""

    def __init__(self, operation: Correction, state: ErrorState):
        self._operation = operation
        self._rows = np.concatenate(
            [np.arange(state.vehicle_size), state.rows_of(operation.slots).ravel()]
        )
        self._corrected = state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the correction to before it."""
        return _before(later, self._corrected, self._rows, self._transposed_times)

    def _transposed_times(self, X: Array) -> Array:
        """Rows of H^T X, for X (n r, c), that are not zero."""
        H_vehicle, H_landmark = self._operation.H_vehicle, self._operation.H_landmark
        n, r, s = H_vehicle.shape
        of_landmarks = np.swapaxes(H_landmark, -1, -2) @ X.reshape(n, r, -1)
        of_vehicle = H_vehicle.reshape(n * r, s).T @ X
        return np.concatenate([of_vehicle, of_landmarks.reshape(3 * n, -1)])


class VehicleCorrectionAdjoint:
    """The way back through a correction by the vehicle state."""

    def __init__(self, operation: VehicleCorrection, state: ErrorState):
        self._H_T = operation.H.T
        self._corrected = state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the correction to before it."""
        rows = np.arange(len(self._H_T))
        return _before(later, self._corrected, rows, self._H_T.__matmul__)


def _before(
    later: Adjoint,
    corrected: Corrected,
    rows: NDArray[np.int64],
    transposed_times: Callable[[Array], Array],
) -> Adjoint:
    """Take what is said after a correction to before it, in place.

    Parameters
    ----------
    later : Adjoint
    corrected : Corrected
    rows : ndarray of int64, (k,)
        Components of the error state that H has anything for.
    transposed_times : callable
        Gives these rows (k, c) of ``H^T X`` for X (m, c).
    """
    # Several products with L^-1 take two thirds of the time of solving with L, and the noise in S
    # makes it safe to form.
    L_inverse, _ = lapack.dtrtri(corrected.L, lower=1)
    K_T = blas.dtrmm(1.0, L_inverse, corrected.Y.T, side=1, lower=1).T
    # Transposed, I - K H and L^-1 H differ from the identity and from zero in these rows alone.
    Phi_T = -transposed_times(K_T)
    Phi_T[np.arange(len(rows)), rows] += 1.0
    G = transposed_times(np.tril(L_inverse).T)
    vector, matrix = later.vector, later.matrix
    vector[rows] = G @ corrected.whitened + Phi_T @ vector
    half = Phi_T @ matrix
    own = half @ Phi_T.T + G @ G.T
    matrix[rows] = half
    matrix[:, rows] = half.T
    matrix[np.ix_(rows, rows)] = symmetrized(own)
    return later


class DirectCorrectionAdjoint:
    """The way back through a direct correction, where ``I - K H`` has columns ``[-P_xL; R] S^-1``.

    With ``B = [-P_xL; R]``, ``Lambda_LL <- S^-1 (B^T Lambda B) S^-1 + S^-1``.
    """

    def __init__(self, operation: DirectCorrection, state: ErrorState):
        self._operation = operation
        self._seen_and_rest = operation.seen_and_rest(state)
        _, _, self._S_inverse, self._cross = state.apply(operation)

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the correction to before it."""
        seen, rest = self._seen_and_rest
        S_inverse, cross = self._S_inverse, self._cross
        residual, variances = self._operation.residual.ravel(), self._operation.noise.ravel()
        vector, Lambda = later.vector, later.matrix
        vector[seen] = S_inverse @ (residual + variances * vector[seen] - cross.T @ vector[rest])
        of_rest = _block(Lambda, rest, seen) * variances - _block(Lambda, rest, rest) @ cross
        square = -cross.T @ of_rest
        own = _block(Lambda, seen, seen) * variances
        own -= _block(Lambda, seen, rest) @ cross
        own *= variances[:, None]
        square += own
        put_both(of_rest @ S_inverse, rest, seen, Lambda)
        square = S_inverse @ square @ S_inverse
        mirror_upper(square)
        square += S_inverse
        put(square, seen, seen, Lambda)
        return later


def _block(matrix: Array, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    block = np.empty((len(rows), len(columns)))
    take(matrix, rows, columns, block)
    return block
