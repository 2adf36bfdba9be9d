# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a point of the left image is on its row of the right one, to a pixel.

The match is the place of the highest correlation (zero mean, normalised). What repeats itself
along the row has several such places and is left out: the distance to the second best must be
clearly larger, by the ratio of Lowe, *Distinctive image features* (2004). And the match must
find its way back.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

# Pixels that are compared, to each side: 11 x 11.
_HALF = 5
_SIDE = 2 * _HALF + 1
_COUNT = _SIDE**2
# Lowe's 0.8 is of distances, and 1 - correlation is half of one's square.
_RATIO = 0.64
# Points at infinity may have a disparity that is so far negative by noise and rectification [px].
_BEHIND_INFINITY = 2
# The way back may end this far off [px]: both ways round to whole pixels.
_ROUND_TRIP = 1


def row_search(left: Grey, right: Grey, points: Floats, largest: int) -> tuple[Floats, Floats]:
    """Find disparities of points of the left image.

    Parameters
    ----------
    left, right : ndarray of uint8, (H, W)
    points : ndarray of float32, (n, 2)
    largest : int
        Disparity of the nearest points, pixels.

    Returns
    -------
    disparities : ndarray of float32, (n,)
        Whole pixels; NaN where there is no match, or more than one.
    correlation : ndarray of float32, (n,)
        Of the match.
    """
    disparities = np.full(len(points), np.nan, np.float32)
    correlation = np.full(len(points), -1, np.float32)
    _search_all(
        left,
        right,
        np.ascontiguousarray(np.rint(points), np.int32),
        int(largest),
        disparities,
        correlation,
    )
    return disparities, correlation


@compiled(
    "UniTuple(float64, 3)(uint8[:, ::1], uint8[:, ::1], int64, int64, int64, int64)",
)
def _search(
    pattern: Grey, image: Grey, x: Any, y: Any, low: Any, high: Any
) -> tuple[float, float, float]:
    """Best place from low to high of the pattern about x, y, its correlation, the second best."""
    n = high - low + 1
    row = np.empty(n + _SIDE - 1, np.int32)
    sums, squares = np.zeros(len(row), np.int32), np.zeros(len(row), np.int32)
    products = np.zeros(n, np.int32)
    total, energy = np.int32(0), np.int32(0)
    for a in range(-_HALF, _HALF + 1):
        for k in range(len(row)):
            row[k] = image[y + a, low - _HALF + k]
        for k in range(len(row)):
            sums[k] += row[k]
            squares[k] += row[k] * row[k]
        for b in range(_SIDE):
            value = np.int32(pattern[y + a, x - _HALF + b])
            total += value
            energy += value * value
            for k in range(n):
                products[k] += value * row[k + b]
    # All is whole numbers so far; now sums over the pattern's width, running along.
    scores = np.empty(n, np.float32)
    level, power = np.int32(0), np.int32(0)
    for b in range(_SIDE - 1):
        level += sums[b]
        power += squares[b]
    contrast = np.float32(energy - total * (total / np.float32(_COUNT)))
    for k in range(n):
        level += sums[k + _SIDE - 1]
        power += squares[k + _SIDE - 1]
        spread = np.float32(power - level * (level / np.float32(_COUNT))) * contrast
        common = np.float32(products[k] - total * (level / np.float32(_COUNT)))
        scores[k] = common / np.sqrt(spread) if spread > 1 else np.float32(-1)
        level -= sums[k]
        power -= squares[k]
    best = int(np.argmax(scores))
    # The peak itself is as wide as the pattern's detail: down to where it rises again.
    first, last = best, best
    while first > 0 and scores[first - 1] < scores[first]:
        first -= 1
    while last < n - 1 and scores[last + 1] < scores[last]:
        last += 1
    second = np.float32(-1)
    for k in range(n):
        if (k < first or k > last) and scores[k] > second:
            second = scores[k]
    return float(low + best), float(scores[best]), float(second)


@compiled("void(uint8[:, ::1], uint8[:, ::1], int32[:, ::1], int64, float32[::1], float32[::1])")
def _search_all(
    left: Grey,
    right: Grey,
    places: NDArray[np.int32],
    largest: int,
    disparities: Floats,
    correlation: Floats,
) -> None:
    height, width = left.shape
    for i in range(len(places)):
        x, y = np.int64(places[i, 0]), np.int64(places[i, 1])
        if x < _HALF or y < _HALF or x >= width - _HALF or y >= height - _HALF:
            continue
        low, high = max(x - largest, _HALF), min(x + _BEHIND_INFINITY, width - 1 - _HALF)
        there, score, second = _search(left, right, x, y, low, high)
        correlation[i] = score
        if not 1 - score < _RATIO * (1 - second):
            continue
        match = np.int64(there)
        low, high = max(match - _BEHIND_INFINITY, _HALF), min(match + largest, width - 1 - _HALF)
        back, _, _ = _search(right, left, match, y, low, high)
        if abs(back - x) <= _ROUND_TRIP:
            disparities[i] = x - match
