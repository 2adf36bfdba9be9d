# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a drive agrees with itself on the gyroscope's bias.

Where all noise is what it is taken for, the estimate of a constant moves from one time to a later
one by what its covariance shrinks by, and moves over different stretches are independent::

    b(t_2) - b(t_1) ~ N(0, P(t_1) - P(t_2))

Errors that stay, of tracks or of the measured twist, move it further. The mean square of the
moves, each by its own covariance, is Birge's ratio (Birge, *The calculation of errors by the
method of least squares*, 1932): by so much the data's information on the bias is too large.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A move is taken over so long, that most of what stays has changed meanwhile [s].
_STRETCH = 5.0
# The ratio before a drive has told any, and how many numbers that counts as.
_PRIOR_RATIO, _PRIOR_NUMBERS = 10.0, 3.0
# A stretch that takes less of a variance has told nothing; rounding would be as large.
_LEAST_SHARE = 1e-6


class BiasAgreement:
    """Birge's ratio of a bias that is estimated as a drive goes on."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._before: tuple[Array, Array] | None = None
        self._squares, self._numbers = 0.0, 0

    @property
    def ratio(self) -> float:
        """By how much the data's information on the bias is taken for too large, 1 or more."""
        squares = self._squares + _PRIOR_RATIO * _PRIOR_NUMBERS
        return max(1.0, squares / (self._numbers + _PRIOR_NUMBERS))

    def add(self, seconds: float, bias: Array, covariance: Array, walk: Array) -> None:
        """Take the estimate as it stands after some more seconds.

        Parameters
        ----------
        seconds : float
            Since it was taken last.
        bias : ndarray, (3,)
            rad/s.
        covariance : ndarray, (3, 3)
            Zero where there is no bias.
        walk : ndarray, (3,)
            Variance that the bias itself gathers in a second.
        """
        self._seconds += seconds
        if self._before is not None:
            self._before[1][np.diag_indices(3)] += seconds * walk
        if self._seconds < _STRETCH or not covariance.any():
            return
        if self._before is not None:
            squares = _squares_of_move(*self._before, bias, covariance)
            if squares is None:
                return
            self._squares += float(squares.sum())
            self._numbers += len(squares)
        self._seconds, self._before = 0.0, (bias.copy(), covariance.copy())


def _squares_of_move(b_1: Array, P_1: Array, b_2: Array, P_2: Array) -> Array | None:
    """Squares (3,) of a move in units of its own variance; None where nothing was learned."""
    L_inverse = np.linalg.inv(np.linalg.cholesky(P_1))
    shares, axes = np.linalg.eigh(np.eye(3) - L_inverse @ P_2 @ L_inverse.T)
    if shares[0] < _LEAST_SHARE:
        return None
    return np.asarray((axes.T @ (L_inverse @ (b_2 - b_1))) ** 2 / shares)
