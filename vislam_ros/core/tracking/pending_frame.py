# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A frame of features that waits for its motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PendingFrame:
    """Features of one stamp.

    Attributes
    ----------
    pass_number : int
    stamp : int
        Nanoseconds.
    ids : ndarray of uint32, (n,)
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    noise : ndarray of float32, (n,), or None
        Standard deviation of each observation as its source states it, pixels.
    """

    pass_number: int
    stamp: int
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]
    noise: NDArray[np.float32] | None

    @property
    def weight(self) -> int:
        """What it counts as among those that wait: one, and one more for each thousand points."""
        return 1 + len(self.ids) // 1000
