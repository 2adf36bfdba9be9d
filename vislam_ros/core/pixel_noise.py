# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The level of the pixel noise, learned from whole tracks.

The errors of real tracks are not white: a track's pixels stand beside its point by much the same
amount for all its life. Innovations are then smaller than white noise of the honest level would
have them, and an R that brings the normalised innovation squared to 1 makes the pose far too
sure of itself: it takes ten repetitions of one error for ten independent errors.

So a track is judged by its whole life. With ``w_k = [S^-1 r]_i`` and ``D_k = [S^-1]_ii`` of
landmark i at step k (the score of its observation and the score's variance, the other landmarks'
observations given), ::

    q = (sum w_k)^T (sum D_k)^-1 (sum w_k)

is chi-square distributed with 3 degrees of freedom when the noise is white and of the level told,
and has the same median when R is what a constant error makes of a track. The median of the tracks
that have ended is sought by stochastic approximation (Robbins and Monro, *A stochastic
approximation method*, 1951): outliers count as one track each, nothing but the level is kept, and
the estimate looks back only.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.gating import mahalanobis_squared

Array = NDArray[np.float64]

# Median of chi-square with 3 degrees of freedom, and how fast the share of tracks above it falls
# as the logarithm of their scale does: the median times the density there.
_MEDIAN = 2.366
_SLOPE = 0.445
# About a minute of a drive with 60 tracks in view; the prior counts as the first tracks.
_MEMORY = 4000
_PRIOR_TRACKS = 200
# Bounds of the level: a hundredth and a hundred times the standard deviation told.
_LIMIT = math.log(1e4)


class PixelNoise:
    """Running level of the pixel noise, by the active landmarks of a filter in their order.

    Attributes
    ----------
    level : float
        The variance of the noise in units of that told.
    """

    def __init__(self) -> None:
        self.level = 1.0
        self._ended = 0
        self._score: Array = np.empty((0, 3))
        self._information: Array = np.empty((0, 3, 3))

    def begin(self, count: int) -> None:
        """Append so many landmarks."""
        self._score = np.concatenate([self._score, np.zeros((count, 3))])
        self._information = np.concatenate([self._information, np.zeros((count, 3, 3))])

    def see(self, slots: NDArray[np.int64], S_inverse: Array, weighted: Array) -> None:
        """Take one frame's observations.

        Parameters
        ----------
        slots : ndarray of int64, (n,)
            Places of the landmarks seen, all different.
        S_inverse : ndarray, (3 n, 3 n)
            Inverse of the innovations' covariance, 1 / square pixels.
        weighted : ndarray, (3 n,)
            ``S^-1 r``, 1 / pixels.
        """
        _add(slots, S_inverse, weighted, self._score, self._information)

    def end(self, gone: NDArray[np.bool_]) -> None:
        """Learn from the landmarks (n,) that are gone, and forget them."""
        judged = gone & (self._information[:, 0, 0] > 0)
        score = self._score[judged]
        count = len(score)
        if count:
            q = mahalanobis_squared(score, self._information[judged])
            above = np.count_nonzero(q > _MEDIAN)
            self._ended += count
            change = (above - 0.5 * count) / min(self._ended + _PRIOR_TRACKS, _MEMORY) / _SLOPE
            self.level = math.exp(min(max(math.log(self.level) + change, -_LIMIT), _LIMIT))
        self._score, self._information = self._score[~gone], self._information[~gone]


@compiled("void(int64[:], float64[:, :], float64[::1], float64[:, ::1], float64[:, :, ::1])")
def _add(
    slots: NDArray[np.int64], S_inverse: Array, weighted: Array, score: Array, information: Array
) -> None:
    for i in range(len(slots)):
        for r in range(3):
            score[slots[i], r] += weighted[3 * i + r]
            for c in range(3):
                information[slots[i], r, c] += S_inverse[3 * i + r, 3 * i + c]
