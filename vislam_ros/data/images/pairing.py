# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which stamps of two streams are of the same moment."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.trajectory import NANOSECONDS

Stamps = NDArray[np.int64]


class PairedStamps(NamedTuple):
    """Rows (n,) of the first stream and of the second, both increasing."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]


def half_a_period(stamps: Stamps) -> int:
    """Half the median time between stamps that increase, nanoseconds; zero for a single one."""
    return int(np.median(np.diff(stamps))) // 2 if len(stamps) > 1 else 0


def pair_stamps(first: Stamps, second: Stamps, tolerance: int) -> PairedStamps:
    """Pair stamps (n,) and (m,), strictly increasing, that are each other's nearest.

    Parameters
    ----------
    first, second : ndarray of int64
        Nanoseconds.
    tolerance : int
        Nanoseconds by which they may differ.
    """
    if not len(first) or not len(second):
        nothing = np.empty(0, dtype=np.intp)
        return PairedStamps(nothing, nothing)
    nearest = _nearest(first, second)
    rows = np.arange(len(first))
    mutual = _nearest(second, first)[nearest] == rows
    near = np.abs(second[nearest] - first) <= tolerance
    kept = rows[mutual & near]
    return PairedStamps(kept, nearest[kept])


def _nearest(stamps: Stamps, others: Stamps) -> NDArray[np.intp]:
    """Row of the nearest of some others for each stamp."""
    after = np.clip(np.searchsorted(others, stamps), 0, len(others) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(others[before] - stamps) <= np.abs(others[after] - stamps)
    return np.where(is_before, before, after)


def pairing_notes(
    left: Stamps, right: Stamps, pairs: PairedStamps, what: str = "images"
) -> list[str]:
    """Say how many images of both sides found no partner, and how far the stamps differ."""
    notes = []
    alone = len(left) + len(right) - 2 * len(pairs.first)
    if alone:
        notes.append(f"Left out {alone} {what} without one of the other camera at their stamp.")
    apart = np.abs(left[pairs.first] - right[pairs.second])
    if len(apart) and apart.max() > 0:
        notes.append(
            f"The stamps of left and right differ by up to {apart.max() / NANOSECONDS * 1e3:.3g} "
            "ms: taken for the same moments."
        )
    return notes
