# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which of too many new features to follow: those that cover the image best.

The image is cut into about as many cells as there is room for, and features are taken cell by
cell: one of each that has none, then the second of each, and so on. Cells take turns in an order
that jumps over the image, so that what is left over at the end does not fill it from the top.
The choice depends on the pixels alone; of one cell the smallest ids come first.
"""

import math

import numpy as np
from numpy.typing import NDArray

# As many cells along an axis tell a spread well enough.
_MOST_CELLS = 64
# A few pixels far outside do not stretch the image [%].
_INSIDE = (1.0, 99.0)
# Knuth's multiplicative hash: neighbours come far apart.
_STRIDE = np.uint64(2654435761)


def best_spread(
    pixels: NDArray[np.float32], count: int, beside: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Choose features that cover the image best, together with those that are there already.

    Parameters
    ----------
    pixels : ndarray, (n, 4)
        ``u_left, v_left, ...`` of those to choose from.
    count : int
        How many, fewer than n.
    beside : ndarray, (m, 4)
        Of those that are there already.

    Returns
    -------
    ndarray of int64, (count,)
        Increasing places in ``pixels``.
    """
    side = min(max(math.isqrt(max(count, 1)), 1), _MOST_CELLS)
    low, high = np.percentile(pixels[:, :2], _INSIDE, axis=0)
    scale = side / np.maximum(high - low, 1e-6)

    def cells_of(points: NDArray[np.float32]) -> NDArray[np.int64]:
        place = np.clip((points[:, :2] - low) * scale, 0, side - 1).astype(np.int64)
        return place[:, 0] * side + place[:, 1]

    cells = cells_of(pixels)
    there = np.bincount(cells_of(beside), minlength=side * side)
    by_cell = np.argsort(cells, kind="stable")
    of_cell = np.bincount(cells, minlength=side * side)
    first = np.cumsum(of_cell) - of_cell
    rank = np.empty(len(pixels), dtype=np.int64)
    rank[by_cell] = np.arange(len(pixels)) - np.repeat(first, of_cell)
    turn = (cells.astype(np.uint64) * _STRIDE) & np.uint64(0xFFFFFFFF)
    order = np.lexsort((turn, rank + there[cells]))
    return np.sort(order[:count])
