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

from vislam_ros.core import se3
from vislam_ros.core.linear_update import (
    Rows,
    Scratch,
    block,
    correct_directly,
    diagonal_blocks,
    inverse_of_positive,
    mirror_upper,
    without,
)
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.tracks import Keys

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
        # What P holds of the small part, as it is before the motion: with itself, with landmarks.
        rows = P[:s].copy() if Y is None else P[:s] - Y[:, :s].T @ Y
        P_ss, P_Ls = rows[:, :s], rows[:, s:].T
        m = len(P_Ls)
        P_LL = P[s:, s:]
        if self.landmarks is not None:
            n = len(self.landmarks)
            half = scratch.matrix("work", m, m)
            np.matmul(self.landmarks, P_LL.reshape(n, 3, m), out=half.reshape(n, 3, m))
            np.matmul(self.landmarks, half.T.reshape(n, 3, m), out=P_LL.reshape(n, 3, m))
            P_Ls = (self.landmarks @ P_Ls.reshape(n, 3, s)).reshape(m, s)
            # The rest of C P_ss C^T + C P_sL D^T + D P_Ls C^T - D Y_L^T Y_L D^T is of low rank.
            left, right = [], []
            if self.coupling is not None:
                C = self.coupling.reshape(m, s - 6)
                moved = C @ P_ss[6:]
                with_half = P_Ls[:, 6:] + 0.5 * moved[:, 6:]
                left, right = [with_half, C], [C, with_half]
                P_Ls = P_Ls + moved
            if Y is not None:
                DY = (self.landmarks @ Y[:, s:].T.reshape(n, 3, len(Y))).reshape(m, len(Y))
                left, right = [*left, -DY], [*right, DY]
            if left:
                P_LL += np.matmul(np.hstack(left), np.hstack(right).T, out=half)
        elif Y is not None:
            P_LL -= Y[:, s:].T @ Y[:, s:]
        P_ss = A @ P_ss @ A.T
        P[:s, :s] = symmetrized(P_ss)
        P[s:, :s] = P_Ls @ A.T
        P[:s, s:] = P[s:, :s].T
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


def seen_and_rest(slots: NDArray[np.int64], active: int, s: int) -> tuple[Rows, Rows]:
    """Places of some landmarks' numbers, in the order of ``slots``, and of all else.

    Slices where they are all landmarks in their own order, which is the usual and the fast case.
    """
    if len(slots) == active and np.all(slots[1:] > slots[:-1]):
        return slice(s, None), slice(0, s)
    seen = landmark_rows(slots, s).ravel()
    return seen, np.delete(np.arange(s + 3 * active), seen)


@dataclass(frozen=True)
class DirectCorrection:
    """Update by landmarks whose own three numbers are observed, ``H = [0 I]``.

    Attributes
    ----------
    residual : ndarray, (n, 3)
        ``z - y``.
    noise : ndarray, (3,)
        Variances of each landmark's observation.
    slots : ndarray of int64, (n,)
        Which landmark each residual is of, all different.
    """

    residual: Array
    noise: Array
    slots: NDArray[np.int64]

    def carry(self, P: Array, s: int, scratch: Scratch) -> tuple[Array, Kept]:
        """Return the covariance (D, D) after the update; keep S^-1 and the rows P_xL."""
        seen, rest = seen_and_rest(self.slots, (len(P) - s) // 3, s)
        variances = np.tile(self.noise, len(self.slots))
        S = P[block(seen, seen)].copy()
        S.ravel()[:: len(S) + 1] += variances
        S_inverse = inverse_of_positive(S)
        cross = correct_directly(P, seen, rest, variances, S_inverse)
        return P, (S_inverse, cross)

    def pull_back(self, adjoint: Adjoint, kept: Kept, s: int) -> Adjoint:
        """As of :class:`Correction`, where ``I - K H`` has the columns ``[-P_xL; R] S^-1``.

        All is a sum of squares: ``Lambda_LL <- S^-1 (B^T Lambda B) S^-1 + S^-1`` with
        ``B = [-P_xL; R]``.
        """
        S_inverse, cross = kept
        seen, rest = seen_and_rest(self.slots, (len(adjoint.vector) - s) // 3, s)
        variances = np.tile(self.noise, len(self.slots))
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
