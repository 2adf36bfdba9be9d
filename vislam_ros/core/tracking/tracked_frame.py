# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A frame of features whose observations are assigned to physical points (see tracks)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Keys = NDArray[np.int64]


@dataclass(frozen=True)
class TrackedFrame:
    """One features message, its observations assigned to physical points.

    Those of tracks that rest after a rejection are left out.

    Attributes
    ----------
    keys : ndarray of int64, (n,)
        Physical point of each observation, increasing.
    pixels : ndarray, (n, 4)
        ``u_left, v_left, u_right, v_right`` in the order of ``keys``.
    ended : ndarray of int64, (m,)
        Points that will not be seen again.
    copied : ndarray of bool, (n,)
        Which observations of a frozen frame repeat the last one's pixels; each begins a point.
    frozen : bool
        Whether the frame repeats the last one's pixels while the body moves.
    left_out : int
        New tracks that there was no room for.
    noise : ndarray, (n,), or None
        Standard deviation of each observation as its source states it, pixels.
    """

    keys: Keys
    pixels: NDArray[np.float64]
    ended: Keys
    copied: NDArray[np.bool_]
    frozen: bool
    left_out: int = 0
    noise: NDArray[np.float64] | None = None
