# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Angular velocities of one pass, as they come, and how far the body has turned by them."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.frontend.turns import turn_between

Array = NDArray[np.float64]

# Where no images come: more than lie between two of them [samples].
_MOST_SAMPLES = 20_000


class Gyroscope:
    """Keeps what the next images may need."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._omegas: list[Array] = []

    def add(self, stamp: int, omega: Array) -> None:
        """Add an angular velocity (3,) with a stamp (ns) later than all before."""
        self._stamps.append(stamp)
        self._omegas.append(omega)
        if len(self._stamps) > _MOST_SAMPLES:
            self._forget(_MOST_SAMPLES // 2)

    def reaches(self, stamp: int) -> bool:
        """Tell whether there is a sample at a stamp (ns) or after it."""
        return bool(self._stamps) and stamp <= self._stamps[-1]

    def turn_between(self, begin: int, end: int) -> Array | None:
        """Rotation (3, 3) of the body, see :func:`vislam_ros.frontend.turns.turn_between`."""
        stamps = np.array(self._stamps, dtype=np.int64)
        return turn_between(stamps, np.array(self._omegas).reshape(-1, 3), begin, end)

    def forget_before(self, stamp: int) -> None:
        """Drop the samples that no stamp from this one (ns) on can need."""
        stamps = np.array(self._stamps, dtype=np.int64)
        self._forget(max(int(np.searchsorted(stamps, stamp, side="right")) - 1, 0))

    def _forget(self, count: int) -> None:
        del self._stamps[:count], self._omegas[:count]
