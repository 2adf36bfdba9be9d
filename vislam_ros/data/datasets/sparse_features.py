# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From the dense feature array of a dataset, mostly -1, to its observations alone."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.data.datasets.arrays.array_stream import ArrayStream
from vislam_ros.errors import VislamError

ABSENT = -1.0
# What arrays are made of where nobody fills them: no point lies in the corner of both images.
_EMPTY = 0.0

# A pixel has a mantissa full of noise, and hardly packs; in memory it takes more than in a file.
# So a stored byte stands for no more pixels than this, or for these where they are few or some.
_PIXELS_OF_A_BYTE, _FEW, _SOME_OF_A_BYTE, _SOME = 4, 1 << 20, 16, 1 << 25

Progress = Callable[[float], None]


#: Which axes of an array are its pixels' components, its tracks and its steps.
Axes = tuple[int, int, int]


@dataclass(frozen=True)
class DenseFeatures:
    """Observations as a file has them, sorted by (step, id).

    Attributes
    ----------
    steps : int
    step_of : ndarray of int64, (n,)
    ids : ndarray of uint32, (n,)
    pixels : ndarray of float64, (n, 4)
        ``u_left, v_left, u_right, v_right``; whatever numbers they are.
    empty : int
        Entries left out because they are 0 0 0 0.
    """

    steps: int
    step_of: NDArray[np.int64]
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float64]
    empty: int = 0


@dataclass(frozen=True)
class SparseFeatures:
    """Observations that can be used, sorted by (step, id).

    Attributes
    ----------
    offsets : ndarray of int64, (T + 1,)
        Step ``k`` has the rows ``offsets[k]:offsets[k + 1]``.
    ids : ndarray of uint32, (n,)
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    unusable : int
        Observations left out because a pixel is not finite or beyond LARGEST_PIXEL.
    """

    offsets: NDArray[np.int64]
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]
    unusable: int


def no_features(steps: int) -> DenseFeatures:
    """Observations of a file without any."""
    return DenseFeatures(
        steps, np.empty(0, dtype=np.int64), np.empty(0, dtype=np.uint32), np.empty((0, 4))
    )


def rectified(
    features: DenseFeatures, rectification: PixelRectification | None = None
) -> SparseFeatures:
    """Rectify pixels before they are rounded to single precision, and keep what can be used."""
    exact = features.pixels
    if rectification is not None:
        exact = rectification.pixels(exact)
    with np.errstate(over="ignore"):
        pixels = exact.astype(np.float32)
    # A float that is not finite fails the comparison too.
    usable = np.all(np.abs(pixels) < LARGEST_PIXEL, axis=1)
    return SparseFeatures(
        offsets=np.searchsorted(features.step_of[usable], np.arange(features.steps + 1)),
        ids=features.ids[usable],
        pixels=pixels[usable],
        unusable=int(np.sum(~usable)),
    )


def gather_observations(
    opened: Callable[[], ArrayStream],
    progress: Progress | None = None,
    *,
    axes: Axes = (0, 1, 2),
) -> DenseFeatures:
    """Pick the observations out of a dense array in one pass over its bytes.

    An observation is absent where all four of its pixels are -1, or 0. A single 0 in an
    observation is a pixel: where there are such, a second pass fetches them.

    Parameters
    ----------
    opened : callable
        Opens the array, of shape (4, M, T), in either order.
    progress : callable, optional
        Told the share done, 0 to 1.
    axes : tuple of int, (3,), optional
        Which of its axes has the length 4, which M and which T, where they are permuted.

    Raises
    ------
    VislamError
        Where it unpacks to more observations than its bytes can tell.
    """
    stream = opened()
    M, T = stream.shape[axes[1]], stream.shape[axes[2]]
    total = math.prod(stream.shape)
    # A cell is a (step, track) pair, numbered in the order that is wanted.
    cells: list[list[NDArray[np.int64]]] = [[], [], [], []]
    values: list[list[NDArray[np.float64]]] = [[], [], [], []]
    start = zeros = 0
    pixels_left = max(
        _PIXELS_OF_A_BYTE * stream.stored, min(_FEW + _SOME_OF_A_BYTE * stream.stored, _SOME)
    )
    for chunk in stream.chunks:
        is_zero = chunk == _EMPTY
        zeros += int(np.count_nonzero(is_zero))
        (present,) = np.nonzero((chunk != ABSENT) & ~is_zero)
        pixels_left -= len(present)
        if pixels_left < 0:
            raise VislamError(
                f"{stream.source}: {stream.stored} bytes unpack to more observations than so many "
                "bytes can tell"
            )
        present_values = chunk[present].astype(np.float64)
        component, cell = _places(stream, axes, present + start)
        for c in range(4):
            of_c = component == c
            cells[c].append(cell[of_c])
            values[c].append(present_values[of_c])
        start += len(chunk)
        if progress is not None:
            progress(start / total)

    every_cell = [np.concatenate([np.empty(0, dtype=np.int64), *part]) for part in cells]
    every_value = [np.concatenate([np.empty(0), *part]) for part in values]
    first = every_cell[0]
    if all(np.array_equal(other, first) for other in every_cell[1:]):  # as trackers write them
        rows = np.argsort(first, kind="stable")
        seen, pixels = first[rows], np.column_stack(every_value)[rows]
    else:
        seen = np.unique(np.concatenate(every_cell))
        pixels = np.full((len(seen), 4), ABSENT)
        for c in range(4):
            pixels[np.searchsorted(seen, every_cell[c]), c] = every_value[c]
        if zeros:
            _put_zeros(opened(), axes, seen, pixels)
    step_of, tracks = np.divmod(seen, max(M, 1))
    empty = (zeros - int(np.count_nonzero(pixels == _EMPTY))) // 4
    return DenseFeatures(T, step_of, tracks.astype(np.uint32), pixels, empty)


def _places(
    stream: ArrayStream, axes: Axes, places: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Component and cell of numbers, by their places in the order of the bytes."""
    order: Literal["F", "C"] = "F" if stream.fortran_order else "C"
    place = np.unravel_index(places, stream.shape, order)
    component, track, step = (place[axis] for axis in axes)
    return component, step * stream.shape[axes[1]] + track


def _put_zeros(
    stream: ArrayStream, axes: Axes, seen: NDArray[np.int64], pixels: NDArray[np.float64]
) -> None:
    """Put the zeros of cells that are seen, sorted, among their pixels (n, 4)."""
    start = 0
    for chunk in stream.chunks:
        (places,) = np.nonzero(chunk == _EMPTY)
        component, cell = _places(stream, axes, places + start)
        row = np.minimum(np.searchsorted(seen, cell), len(seen) - 1)
        of_seen = seen[row] == cell
        pixels[row[of_seen], component[of_seen]] = _EMPTY
        start += len(chunk)
