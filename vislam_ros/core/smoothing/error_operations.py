# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a filter does to its error state, one class an operation, forwards and backwards.

The error state is ``[small; delta_1; ...; delta_n]``: a small part that begins with the pose error
``[rho; theta]`` on the right, and three numbers for each active landmark. Forwards an operation
carries the covariance P, backwards it carries adjoints, both in place where their size stays.
They are those of the modified Bryson-Fraser smoother (Bierman, *Fixed interval smoothing with
discrete measurements*, 1973): if C is the cross-covariance of anything with the error state at
some time, then all that was observed later moves its estimate by ``C lambda`` and lowers its
covariance by ``C Lambda C^T``.

An update moves the pose by ``T <- T Exp(delta)`` and from then on the error is one about the new
pose. The Jacobian of that change is the identity to first order, and the identity is what the
filter takes it for; so is it here, which makes the smoothed estimates those of the filter's own
linear system, to rounding.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.geometry import se3
from vislam_ros.core.linalg.linear_update import (
    Rows,
    Scratch,
    block,
    correct_directly,
    diagonal_blocks,
    innovation_covariance,
    inverse_of_positive,
    mirror_lower,
    mirror_upper,
    without,
)
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.tracking.tracked_frame import Keys

Array = NDArray[np.float64]
Kept = tuple[Array, ...]
"""What an operation's way back needs of the covariance that it met on its way forward."""


def landmark_rows(slots: NDArray[np.int64], s: int) -> NDArray[np.int64]:
    """Places (n, 3) of landmarks' numbers in an error state whose small part has s."""
    return s + 3 * slots[:, None] + np.arange(3)


@dataclass(frozen=True)
class Adjoint:
    """What all later observations say of the error state.

    Attributes
    ----------
    vector : ndarray, (D,)
        lambda.
    matrix : ndarray, (D, D)
        Lambda, symmetric.
    """

    vector: Array
    matrix: Array


@dataclass(frozen=True)
class RandomWalk:
    """The small part takes a random step: ``P_ss <- P_ss + noise``.

    Attributes
    ----------
    noise : ndarray, (s, s)
    """

    noise: Array

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance (D, D) after the step."""
        P[:s, :s] += self.noise
        return P, ()

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """Return the adjoint as it is."""
        return adjoint


@dataclass(frozen=True)
class Transition:
    """Motion: ``P <- F P F^T`` with ``F = [[A, 0], [C, D]]``, D block-diagonal.

    Attributes
    ----------
    small : ndarray, (s, s)
        A.
    landmarks : ndarray, (n, 3, 3), or None
        Blocks of D; None for landmarks that stay.
    coupling : ndarray, (n, 3, s - 6), or None
        C: how the landmarks depend on what follows the pose in the small part, for no motion of
        the camera's own frame depends on where that lies. None with landmarks that stay.
    """

    small: Array
    landmarks: Array | None = None
    coupling: Array | None = None

    def carry(
        self, P: Array, s: int, scratch: Scratch, Y: Array | None = None
    ) -> tuple[Array, Kept]:
        """Return the covariance (D, D) after the motion.

        A correction of low rank just before it, ``P <- P - Y^T Y`` with Y (k, D), costs less
        together with it than alone.
        """
        A = self.small
        if Y is None:
            Y = np.empty((0, len(P)))
        if self.landmarks is not None:
            n, m = len(self.landmarks), len(P) - s
            C = np.zeros((n, 3, s - 6)) if self.coupling is None else self.coupling
            P_ss, P_sL, left, right = _moved_with_small(P, s, Y, self.landmarks, C)
            rest = scratch.matrix("work", m, m)
            np.matmul(left.T, right, out=rest)
            _move_landmarks(P, s, self.landmarks, rest)
        else:
            rows = P[:s] - Y[:, :s].T @ Y
            P_ss, P_sL = rows[:, :s], rows[:, s:]
            P[s:, s:] -= Y[:, s:].T @ Y[:, s:]
        P[:s, :s] = A @ P_ss @ A.T
        mirror_lower(P[:s, :s])
        P[:s, s:] = A @ P_sL
        P[s:, :s] = P[:s, s:].T
        return P, ()

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """``lambda <- F^T lambda``, ``Lambda <- F^T Lambda F``."""
        vector = np.empty_like(adjoint.vector)
        self._transposed_times(adjoint.vector[:, None], vector[:, None])
        half = np.empty_like(adjoint.matrix)
        self._transposed_times(adjoint.matrix, half)
        self._transposed_times(half.T, adjoint.matrix)
        mirror_upper(adjoint.matrix)
        return Adjoint(vector, adjoint.matrix)

    def _transposed_times(self, X: Array, result: Array) -> None:
        """Put F^T X into a result (D, c) for X (D, c)."""
        s, columns = len(self.small), X.shape[1]
        np.matmul(self.small.T, X[:s], out=result[:s])
        if self.landmarks is None:
            result[s:] = X[s:]
        else:
            blocks = result[s:].reshape(-1, 3, columns)
            transposed = np.swapaxes(self.landmarks, -1, -2)
            np.matmul(transposed, X[s:].reshape(-1, 3, columns), out=blocks)
        if self.coupling is not None:
            result[6:s] += self.coupling.reshape(len(X) - s, s - 6).T @ X[s:]


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
def _moved_with_small(
    P: Array, s: int, Y: Array, D: Array, C: Array
) -> tuple[Array, Array, Array, Array]:
    """Move by D (n, 3, 3) and C (n, 3, s - 6) what P - Y^T Y holds of the small part.

    Returns
    -------
    P_ss : ndarray, (s, s)
        As it was.
    P_sL : ndarray, (s, 3 n)
        ``P_sL D^T + P_ss C^T``.
    left, right : ndarray, (k, 3 n)
        ``C P_ss C^T + C P_sL D^T + D P_Ls C^T - D Y_L^T Y_L D^T`` is ``left^T right``.
    """
    m, k_Y = 3 * len(D), len(Y)
    rows = P[:s].copy()
    for i in range(s):
        for k in range(k_Y):
            for j in range(len(P)):
                rows[i, j] -= Y[k, i] * Y[k, j]
    # Few columns of C are not zero: the biases show in nothing but the twist's measurement.
    used = [c for c in range(s - 6) if np.any(C[:, :, c])]
    r = len(used)
    left, right = np.empty((2 * r + k_Y, m)), np.empty((2 * r + k_Y, m))
    _times_transposed(Y[:, s:], D, right[2 * r :])
    P_sL = np.empty((s, m))
    _times_transposed(rows[:, s:], D, P_sL)
    for j in range(m):
        for k in range(r):
            left[r + k, j] = right[k, j] = C[j // 3, j % 3, used[k]]
            left[k, j] = P_sL[6 + used[k], j]
        for k in range(2 * r, 2 * r + k_Y):
            left[k, j] = -right[k, j]
    for i in range(s):
        for k in range(r):
            for j in range(m):
                P_sL[i, j] += rows[i, 6 + used[k]] * right[k, j]
    for k in range(r):
        # Half of C P_ss C^T on each side.
        for j in range(m):
            left[k, j] = 0.5 * (left[k, j] + P_sL[6 + used[k], j])
            right[r + k, j] = left[k, j]
    return rows[:, :s].copy(), P_sL, left, right


@compiled("void(float64[:, ::1], int64, float64[:, :, ::1], float64[:, ::1])")
def _move_landmarks(P: Array, s: int, D: Array, rest: Array) -> None:
    """``P_LL <- D P_LL D^T + rest`` by the lower triangle, for D of blocks (n, 3, 3)."""
    P_LL, half = P[s:, s:], np.empty((3, 3))
    for i in range(len(D)):
        rows = slice(3 * i, 3 * i + 3)
        for j in range(i + 1):
            columns = slice(3 * j, 3 * j + 3)
            own, mirrored, more = P_LL[rows, columns], P_LL[columns, rows], rest[rows, columns]
            for r in range(3):
                for c in range(3):
                    half[r, c] = 0.0
                    for k in range(3):
                        half[r, c] += D[i, r, k] * own[k, c]
            for r in range(3):
                for c in range(3):
                    moved = more[r, c]
                    for k in range(3):
                        moved += half[r, k] * D[j, c, k]
                    own[r, c] = mirrored[c, r] = moved


@dataclass(frozen=True)
class Correction:
    """Update ``P <- P - K S K^T`` by n groups of r rows with independent noise.

    Attributes
    ----------
    residual : ndarray, (n, r)
        ``z - h``.
    noise : ndarray, (r, r) or (n, r, r)
        R.
    H_small : ndarray, (n, r, s), or None
    H_landmark : ndarray, (n, r, 3), or None
    slots : ndarray of int64, (n,), or None
        Which landmark each group sees, all different; None with ``H_landmark``.
    """

    residual: Array
    noise: Array
    H_small: Array | None = None
    H_landmark: Array | None = None
    slots: NDArray[np.int64] | None = None

    def _whitened(self, s: int) -> tuple[Array, Array, Array]:
        """Residual (n, r), H_small (n, r, s) and H_landmark (n or 0, r, 3) of unit noise."""
        n, r = self.residual.shape
        W = np.linalg.inv(np.linalg.cholesky(self.noise))
        H_small = np.zeros((n, r, s)) if self.H_small is None else W @ self.H_small
        H_landmark = np.zeros((0, r, 3)) if self.H_landmark is None else W @ self.H_landmark
        return (W @ self.residual[..., None])[..., 0], H_small, H_landmark

    def _rows(self, s: int) -> NDArray[np.int64]:
        """Places (3 n,) of the landmarks' components in the error state."""
        if self.slots is None:
            return np.empty(0, dtype=np.int64)
        return landmark_rows(self.slots, s).ravel()

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance (D, D) after the update; keep L^-1 of S = L L^T and Y = L^-1 H P.

        Both ways need several products with L^-1, which a noise of at least 1 in S makes safe to
        form: together they take two thirds of the time of solving with L.
        """
        _, H_small, H_landmark = self._whitened(s)
        n, r, _ = H_small.shape
        rows = self._rows(s)
        HP = H_small.reshape(n * r, s) @ P[:s]
        if len(rows):
            HP += (H_landmark @ P[rows].reshape(n, 3, -1)).reshape(n * r, -1)
        S = HP[:, :s] @ H_small.reshape(n * r, s).T
        if len(rows):
            columns = HP[:, rows].T.reshape(n, 3, n * r)
            S += (H_landmark @ columns).reshape(n * r, n * r).T
        S[np.diag_indices(n * r)] += 1.0
        L = scipy.linalg.cholesky(S, lower=True, overwrite_a=True, check_finite=False)
        L_inverse, _ = scipy.linalg.lapack.dtrtri(L, lower=1)
        Y_T = scipy.linalg.blas.dtrmm(1.0, L_inverse, HP.T, side=1, lower=1, trans_a=1)
        scipy.linalg.blas.dsyrk(-1.0, Y_T, beta=1.0, c=P.T, lower=1, overwrite_c=1)
        mirror_upper(P)
        return P, (L_inverse, Y_T)

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """``lambda <- H^T S^-1 r + (I - K H)^T lambda``, and Lambda likewise.

        ``Lambda <- H^T S^-1 H + (I - K H)^T Lambda (I - K H)`` as a sum of squares: forms with
        fewer products exist, but subtract, and lose the sign of Lambda's small eigenvalues.
        """
        L_inverse, Y_T = kept
        residual, H_small, H_landmark = self._whitened(s)
        n, r, _ = H_small.shape
        size = len(Y_T)
        K_T = scipy.linalg.blas.dtrmm(1.0, L_inverse, Y_T, side=1, lower=1).T
        # Transposed, (I - K H)^T and (L^-1 H)^T have blocks of rows, and only those of what is
        # observed differ from the identity's and from zero.
        seen, blocks, G = [], [], []
        if self.H_small is not None:
            flat_small = H_small.reshape(n * r, s)
            seen.append(np.arange(s))
            blocks.append(-flat_small.T @ K_T)
            G.append(flat_small.T @ L_inverse.T)
        if self.H_landmark is not None:
            H_landmark_T = np.swapaxes(H_landmark, -1, -2)
            seen.append(self._rows(s))
            blocks.append(-(H_landmark_T @ K_T.reshape(n, r, size)).reshape(3 * n, size))
            G.append((H_landmark_T @ L_inverse.T.reshape(n, r, n * r)).reshape(3 * n, n * r))
        rows, Phi_T, G_rows = np.concatenate(seen), np.concatenate(blocks), np.concatenate(G)
        Phi_T[np.arange(len(rows)), rows] += 1.0
        vector, matrix = adjoint.vector, adjoint.matrix
        vector[rows] = G_rows @ (L_inverse @ residual.ravel()) + Phi_T @ vector
        # The other rows of (I - K H)^T are those of the identity.
        half = Phi_T @ matrix
        own = half @ Phi_T.T + G_rows @ G_rows.T
        matrix[rows] = half
        matrix[:, rows] = half.T
        matrix[np.ix_(rows, rows)] = symmetrized(own)
        return Adjoint(vector, matrix)


@compiled("UniTuple(int64[::1], 2)(int64[:], int64[:], int64, int64)")
def seen_and_rest(
    slots: NDArray[np.int64], components: NDArray[np.int64], active: int, s: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places of some landmarks' numbers, in the order of ``slots``, and of all else.

    Of the three numbers of a landmark those count that ``components`` (r,) names.
    """
    r = len(components)
    seen, is_rest = np.empty(r * len(slots), dtype=np.int64), np.ones(s + 3 * active, np.bool_)
    for i in range(len(slots)):
        for k in range(r):
            place = s + 3 * slots[i] + components[k]
            seen[r * i + k] = place
            is_rest[place] = False
    return seen, np.flatnonzero(is_rest)


def _sliced(places: NDArray[np.int64]) -> Rows:
    """Make places a slice where they follow each other, so that a block of them is a view."""
    if len(places) and np.all(places[1:] == places[:-1] + 1):
        return slice(int(places[0]), int(places[-1]) + 1)
    return places


@dataclass(frozen=True)
class DirectCorrection:
    """Update by landmarks of whose own three numbers some are observed, ``H = [0 I]``.

    Attributes
    ----------
    residual : ndarray, (n, r)
        ``z - y``.
    noise : ndarray, (n, r)
        Variances of the observations.
    slots : ndarray of int64, (n,)
        Which landmark each residual is of, all different.
    components : ndarray of int64, (r,)
        Which of a landmark's three numbers are observed, in their order.
    """

    residual: Array
    noise: Array
    slots: NDArray[np.int64]
    components: NDArray[np.int64]

    def _seen_and_rest(self, size: int, s: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return seen_and_rest(self.slots, self.components, (size - s) // 3, s)

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance (D, D) after the update; keep S^-1 and the rows P_xL."""
        seen, rest = self._seen_and_rest(len(P), s)
        variances = self.noise.ravel()
        S = np.empty((len(variances), len(variances)))
        innovation_covariance(P, seen, variances, S)
        S_inverse = inverse_of_positive(S)
        cross = correct_directly(P, seen, rest, variances, S_inverse)
        return P, (S_inverse, cross)

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """As of :class:`Correction`, where ``I - K H`` has the columns ``[-P_xL; R] S^-1``.

        All is a sum of squares: ``Lambda_LL <- S^-1 (B^T Lambda B) S^-1 + S^-1`` with
        ``B = [-P_xL; R]``.
        """
        S_inverse, cross = kept
        seen, rest = map(_sliced, self._seen_and_rest(len(adjoint.vector), s))
        variances = self.noise.ravel()
        vector, Lambda = adjoint.vector, adjoint.matrix
        vector[seen] = S_inverse @ (
            self.residual.ravel() + variances * vector[seen] - cross.T @ vector[rest]
        )
        of_rest = Lambda[block(rest, seen)] * variances - Lambda[block(rest, rest)] @ cross
        square = -cross.T @ of_rest
        own = Lambda[block(seen, seen)] * variances
        own -= Lambda[block(seen, rest)] @ cross
        own *= variances[:, None]
        square += own
        mixed = of_rest @ S_inverse
        Lambda[block(rest, seen)] = mixed
        Lambda[block(seen, rest)] = mixed.T
        square = S_inverse @ square @ S_inverse
        mirror_upper(square)
        square += S_inverse
        Lambda[block(seen, seen)] = square
        return Adjoint(vector, Lambda)


@dataclass(frozen=True)
class Retirement:
    """Landmarks leave the error state, in which they can no longer be observed.

    Attributes
    ----------
    keys : ndarray of int64, (m,)
    positions : ndarray, (m, 3)
        World positions as they stood, metres.
    gone : ndarray of bool, (n,)
        Which slots they leave.
    J_small : ndarray, (m, 3, s), or None
        Derivative of the world position by the small part; None for 0.
    J_landmark : ndarray, (m, 3, 3), or None
        Derivative of the world position by the landmark's own part; None for the identity.
    """

    keys: Keys
    positions: Array
    gone: NDArray[np.bool_]
    J_small: Array | None = None
    J_landmark: Array | None = None

    def _remaining(self, s: int) -> NDArray[np.bool_]:
        return np.concatenate([np.ones(s, dtype=bool), np.repeat(~self.gone, 3)])

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance of the rest; keep C (3 m, D) and P_mm (m, 3, 3)."""
        m = len(self.keys)
        remaining = self._remaining(s)
        C = P[~remaining]
        if self.J_landmark is not None:
            C = (self.J_landmark @ C.reshape(m, 3, len(P))).reshape(3 * m, len(P))
        if self.J_small is not None:
            C = C + self.J_small.reshape(3 * m, s) @ P[:s]
        own = diagonal_blocks(C[:, ~remaining], 3)
        if self.J_landmark is not None:
            own = own @ np.swapaxes(self.J_landmark, -1, -2)
        if self.J_small is not None:
            small = C[:, :s].reshape(m, 3, s)
            own = own + small @ np.swapaxes(self.J_small, -1, -2)
        rest = without(P, np.flatnonzero(remaining), scratch)
        return rest, (C[:, remaining], symmetrized(own))

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """Pad with zeros: nothing later was said of them but by way of the others."""
        remaining = self._remaining(s)
        vector = np.zeros(len(remaining))
        matrix = np.zeros((len(remaining), len(remaining)))
        vector[remaining] = adjoint.vector
        matrix[np.ix_(remaining, remaining)] = adjoint.matrix
        return Adjoint(vector, matrix)

    def final(self, adjoint: Adjoint, kept: Kept) -> tuple[Array, Array]:
        """World positions (m, 3) and covariances (m, 3, 3) after all that came later."""
        C, own = kept
        m = len(self.keys)
        positions = self.positions + (C @ adjoint.vector).reshape(m, 3)
        C_Lambda = (C @ adjoint.matrix).reshape(m, 3, -1)
        gain = C_Lambda @ np.swapaxes(C.reshape(m, 3, -1), -1, -2)
        return positions, symmetrized(own - gain)


@dataclass(frozen=True)
class Admission:
    """Landmarks join at the end: ``delta_new = J small + noise``.

    Attributes
    ----------
    noise : ndarray, (m, 3, 3)
    J : ndarray, (m, 3, s), or None
        None for 0.
    """

    noise: Array
    J: Array | None = None

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance with the new landmarks."""
        size, m = len(P), len(self.noise)
        grown = scratch.successor(P, size + 3 * m)
        grown[:size, :size] = P
        grown[size:] = 0.0
        grown[:size, size:] = 0.0
        if self.J is not None:
            J = self.J.reshape(3 * m, s)
            cross = J @ P[:s]
            grown[size:, :size] = cross
            grown[:size, size:] = cross.T
            grown[size:, size:] = symmetrized(cross[:, :s] @ J.T)
        places = size + np.arange(3 * m).reshape(m, 3)
        grown[places[:, :, None], places[:, None, :]] += self.noise
        return grown, ()

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """Fold with ``[I; J]^T``: what is said of a new landmark is said of what it came from."""
        size = len(adjoint.vector) - 3 * len(self.noise)
        vector = adjoint.vector[:size].copy()
        matrix = adjoint.matrix[:size, :size].copy()
        if self.J is not None:
            J = self.J.reshape(-1, s)
            vector[:s] += J.T @ adjoint.vector[size:]
            cross = J.T @ adjoint.matrix[size:, :size]
            matrix[:s] += cross
            matrix[:, :s] += cross.T
            matrix[:s, :s] += symmetrized(J.T @ adjoint.matrix[size:, size:] @ J)
        return Adjoint(vector, matrix)


@dataclass(frozen=True)
class PoseMark:
    """A pose to be smoothed: the error state stays as it is.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    """

    T_world_body: Array

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance as it is; keep the pose's rows C (6, D)."""
        return P, (P[:6].copy(),)

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """Return the adjoint as it is."""
        return adjoint

    def smoothed(self, adjoint: Adjoint, kept: Kept) -> tuple[Array, Array]:
        """Pose (4, 4) and its covariance (6, 6) after all that came later."""
        (C,) = kept
        T = self.T_world_body @ se3.exp(C @ adjoint.vector)
        return T, symmetrized(C[:, :6] - C @ adjoint.matrix @ C.T)


Operation = (
    RandomWalk | Transition | Correction | DirectCorrection | Retirement | Admission | PoseMark
)
