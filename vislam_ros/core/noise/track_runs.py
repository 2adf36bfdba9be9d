# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks that slide: each innovation may be small, but all of them point one way.

A car that passes, a shadow, the edge of a roof against the sky: such a track moves a pixel or two
a frame beyond what the motion explains, and no gate on a single frame sees it. But a filter's
innovations are white (Kailath, *An innovations approach to least-squares estimation*, 1968), so
the sum of n of them, whitened, has n times the covariance of one. ``|sum|^2 / n`` is chi-square
like the squared distance of a single innovation, and the same gate serves both: a test of the
running sum (Page, *Continuous inspection schemes*, 1954).
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Array = NDArray[np.float64]


class TrackRuns:
    """Sums of the innovations of each active landmark of a filter, in their order."""

    def __init__(self) -> None:
        self._sums: Array = np.empty((0, 3))
        self._frames: Array = np.empty(0)

    def add(self, count: int) -> None:
        """Append so many landmarks."""
        self._sums = np.concatenate([self._sums, np.zeros((count, 3))])
        self._frames = np.concatenate([self._frames, np.zeros(count)])

    def remove(self, gone: NDArray[np.bool_]) -> None:
        """Remove the landmarks (n,) that are gone."""
        self._sums, self._frames = self._sums[~gone], self._frames[~gone]

    def update(
        self, indices: NDArray[np.int64], components: NDArray[np.int64], white: Array
    ) -> Array:
        """Add a frame and return how far off all of each track's frames together are.

        Parameters
        ----------
        indices : ndarray of int64, (n,)
            Indices of the landmarks seen, all different.
        components : ndarray of int64, (r,)
            Which of a landmark's three numbers were observed.
        white : ndarray, (n, r)
            Their innovations, whitened.

        Returns
        -------
        ndarray, (n,)
            ``|sum|^2 / n``, chi-square with r degrees of freedom where the track does not slide.
        """
        distances: Array = _add_frame(self._sums, self._frames, indices, components, white)
        return distances


@compiled("float64[::1](float64[:, ::1], float64[::1], int64[::1], int64[::1], float64[:, ::1])")
def _add_frame(
    sums: Array,
    frames: Array,
    indices: NDArray[np.int64],
    components: NDArray[np.int64],
    white: Array,
) -> Array:
    distances = np.zeros(len(indices))
    for i in range(len(indices)):
        track = indices[i]
        frames[track] += 1.0
        for k in range(len(components)):
            sums[track, components[k]] += white[i, k]
            distances[i] += sums[track, components[k]] ** 2
        distances[i] /= frames[track]
    return distances
