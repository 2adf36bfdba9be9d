# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A share of the tracks, the same in every frame and every run."""

import numpy as np
from numpy.typing import NDArray


def chosen_tracks(ids: NDArray[np.uint32], fraction: float, seed: int) -> NDArray[np.bool_]:
    """Tell which tracks (n,) are in a share of all, by their ids and the seed alone.

    The bits of an id are mixed as in SplitMix64 (Steele, Lea and Flood, *Fast splittable
    pseudorandom number generators*, 2014), so a track is in or out for good.
    """
    if fraction >= 1.0:
        return np.ones(len(ids), dtype=bool)
    mixed = ids.astype(np.uint64) + np.uint64(seed * 0x9E3779B97F4A7C15 % 2**64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    mixed ^= mixed >> np.uint64(31)
    return mixed < np.uint64(min(fraction * 2.0**64, 2.0**64 - 2**11))
