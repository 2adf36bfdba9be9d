# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From the dense feature array of a dataset, mostly -1, to its observations alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.data.datasets.array_stream import ArrayStream
from vislam_ros.errors import VislamError

ABSENT = -1.0

# A pixel has a mantissa full of noise, and hardly packs; in memory it takes more than in a file.
# So a stored byte stands for no more pixels than this, or for these where they are few or some.
_PIXELS_OF_A_BYTE, _FEW, _SOME_OF_A_BYTE, _SOME = 4, 1 << 20, 16, 1 << 25

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SparseFeatures:
    """Observations sorted by (step, id).

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


def gather_observations(stream: ArrayStream, progress: Progress | None = None) -> SparseFeatures:
    """Pick the observations out of a dense (4, M, T) array in one pass over its bytes.

    An observation is absent where all four of its pixels are -1.

    Parameters
    ----------
    stream : ArrayStream
        Of shape (4, M, T), in either order.
    progress : callable, optional
        Told the share done, 0 to 1.

    Raises
    ------
    VislamError
        Where it unpacks to more observations than its bytes can tell.
    """
    _, M, T = stream.shape
    total = 4 * M * T
    # A cell is a (track, step) pair, numbered as it lies in memory.
    cells: list[list[NDArray[np.int64]]] = [[], [], [], []]
    values: list[list[NDArray[np.float32]]] = [[], [], [], []]
    start = 0
    pixels_left = max(
        _PIXELS_OF_A_BYTE * stream.stored, min(_FEW + _SOME_OF_A_BYTE * stream.stored, _SOME)
    )
    for chunk in stream.chunks:
        (present,) = np.nonzero(chunk != ABSENT)
        pixels_left -= len(present)
        if pixels_left < 0:
            raise VislamError(
                f"{stream.source}: {stream.stored} bytes unpack to more observations than so many "
                "bytes can tell"
            )
        with np.errstate(over="ignore"):
            present_values = chunk[present].astype(np.float32)
        index = present + start
        component, cell = (
            (index % 4, index // 4) if stream.fortran_order else np.divmod(index, M * T)
        )
        for c in np.unique(component):
            cells[c].append(cell[component == c])
            values[c].append(present_values[component == c])
        start += len(chunk)
        if progress is not None:
            progress(start / total)

    every_cell = [np.concatenate([np.empty(0, dtype=np.int64), *part]) for part in cells]
    seen = np.unique(np.concatenate(every_cell))
    pixels = np.full((len(seen), 4), ABSENT, dtype=np.float32)
    for c in range(4):
        pixels[np.searchsorted(seen, every_cell[c]), c] = np.concatenate(
            [np.empty(0, dtype=np.float32), *values[c]]
        )
    if stream.fortran_order:
        steps, tracks = np.divmod(seen, max(M, 1))
    else:
        tracks, steps = np.divmod(seen, max(T, 1))

    # A float that is not finite fails the comparison too.
    usable = np.all(np.abs(pixels) < LARGEST_PIXEL, axis=1)
    order = np.lexsort((tracks, steps))
    order = order[usable[order]]
    return SparseFeatures(
        offsets=np.searchsorted(steps[order], np.arange(T + 1)),
        ids=tracks[order].astype(np.uint32),
        pixels=pixels[order],
        unusable=int(np.sum(~usable)),
    )
