# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmarks join the error state (the report's landmark initialization, eq. 4-5 and 38-40)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.motion import symmetrized
from vislam_ros.core.operations.error_state import ErrorState, Operation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Initialization(Operation[None]):
    """Landmarks join at the end: ``delta_new = J vehicle + noise``.

    Attributes
    ----------
    noise : ndarray, (m, 3, 3)
        Covariances of the noise.
    J : ndarray, (m, 3, s), or None
        None for 0: landmarks that depend on nothing before them.
    """

    noise: Array
    J: Array | None = None

    def forward(self, state: ErrorState) -> None:
        """``P <- [I; J] P [I; J]^T`` and the noise."""
        P, s = state.covariance, state.vehicle_size
        size, m = len(P), len(self.noise)
        grown = state.scratch.successor(P, size + 3 * m)
        grown[:size, :size] = P
        grown[size:] = 0.0
        grown[:size, size:] = 0.0
        new = grown[size:, size:]
        if self.J is not None:
            J = self.J.reshape(3 * m, s)
            cross = J @ P[:s]
            grown[size:, :size] = cross
            grown[:size, size:] = cross.T
            new[:] = cross[:, :s] @ J.T
        rows = np.arange(3 * m).reshape(m, 3)
        new[rows[:, :, None], rows[:, None, :]] += self.noise
        if self.J is not None:
            new[:] = symmetrized(new)
        state.covariance = grown
