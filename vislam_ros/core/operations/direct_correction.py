# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Correction by landmarks whose own three numbers are observed, ``H = [0 I]``.

The correction of eq. 69-71 of the report where H picks components of the error state: all of it is
had from ``S^-1`` without another product of its size (see :func:`correct_directly`).
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.gating import Inliers
from vislam_ros.core.linalg.linear_update import (
    correct_directly,
    innovation_covariance,
    inverse_of_positive,
)
from vislam_ros.core.operations.error_state import ErrorState, Operation

Array = NDArray[np.float64]


# Where variances fall by f at once, rounding costs what is left ``eps f^2`` of itself: so far.
_LARGEST_FALL = math.sqrt(1e-6 / float(np.finfo(np.float64).eps))


class DirectlyCorrected(NamedTuple):
    """What a direct correction has found.

    Attributes
    ----------
    delta : ndarray, (D,)
        What the state is to be moved by.
    nis : float
        ``r^T S^-1 r``.
    inverse : ndarray, (m, m)
        ``S^-1`` of the m numbers observed.
    cross : ndarray, (D - m, m)
        Covariance of all else with these, as it was before.
    """

    delta: Array
    nis: float
    inverse: Array
    cross: Array


@dataclass(frozen=True)
class DirectCorrection(Operation[DirectlyCorrected]):
    """Correction by some or all of the three numbers of some landmarks.

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
    inliers : Inliers, optional
        Where a gate has worked out ``S^-1`` and ``S^-1 r`` already.
    """

    residual: Array
    noise: Array
    slots: NDArray[np.int64]
    components: NDArray[np.int64]
    inliers: Inliers | None = None

    def seen_and_rest(self, state: ErrorState) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows of what is observed, in its order, and of all else."""
        return seen_and_rest(self.slots, self.components, state.active, state.vehicle_size)

    def inverse_in(self, state: ErrorState) -> Array:
        """Work out ``S^-1`` (n r, n r)."""
        seen, _ = self.seen_and_rest(state)
        S = state.scratch.matrix("work", len(seen), len(seen))
        innovation_covariance(state.covariance, seen, self.noise.ravel(), S)
        return inverse_of_positive(S)

    def forward(self, state: ErrorState) -> DirectlyCorrected:
        """``P_LL <- R - R S^-1 R`` and what follows from it for the others."""
        r, variances = self.residual.ravel(), self.noise.ravel()
        if self.inliers is None:
            inverse = self.inverse_in(state)
            weighted = inverse @ r
        else:
            inverse, weighted = self.inliers.inverse, self.inliers.weighted
        P, (seen, rest) = state.covariance, self.seen_and_rest(state)
        cross = correct_directly(P, seen, rest, variances, inverse)
        delta = np.empty(len(P))
        delta[seen] = r - variances * weighted
        delta[rest] = cross @ weighted
        return DirectlyCorrected(delta, float(r @ weighted), inverse, cross)

    def recorded(self) -> "DirectCorrection":
        """All but ``S^-1``, which is large and can be worked out again."""
        return replace(self, inliers=None)


def correct_gradually(state: ErrorState, correction: DirectCorrection) -> Array:
    """Apply a correction, in parts where at once it would lose what is left to rounding.

    Before the twist is known an image point is known to thousands of pixels, and a frame later to
    hundredths: ``P_xx - P_xL S^-1 P_Lx`` is then the small difference of large numbers, and its
    variances may be negative. To observe with noise R is to observe the same n times with
    independent noises ``R / w_i``, where the w_i have the sum 1; in a geometric series each part
    takes an equal share of the fall.

    Parameters
    ----------
    state : ErrorState
    correction : DirectCorrection

    Returns
    -------
    ndarray, (D,)
        What the state is to be moved by.
    """
    seen, _ = correction.seen_and_rest(state)
    noise, left = correction.noise, correction.residual
    fall = float(state.covariance.diagonal()[seen].max() / noise.min())
    if fall < _LARGEST_FALL:
        return state.apply(correction).delta
    n = math.ceil(math.log(fall, _LARGEST_FALL))
    weights = fall ** (np.arange(1 - n, 1) / n)
    delta = np.zeros(len(state.covariance))
    for weight in weights / weights.sum():
        part = replace(correction, residual=left, noise=noise / weight, inliers=None)
        delta += state.apply(part).delta
        left = correction.residual - delta[seen].reshape(noise.shape)
    return delta


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
