# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmarks leave the error state, in which they can no longer be observed.

To leave a variable out of a Gaussian is to marginalize it: the covariance of the rest stays as it
is. The backward pass, which goes on to estimate what has left, asks for its world position.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.linear_update import marginal
from vislam_ros.core.operations.error_state import ErrorState, Operation
from vislam_ros.core.tracking.tracked_frame import Keys

Array = NDArray[np.float64]


class WorldPositions(NamedTuple):
    """World positions of landmarks, and how they depend on the error state.

    Attributes
    ----------
    means : ndarray, (m, 3)
        Metres.
    J_vehicle : ndarray, (m, 3, s), or None
        Derivative by the vehicle state; None for 0.
    J_landmark : ndarray, (m, 3, 3), or None
        Derivative by the landmark's own three numbers; None for the identity.
    """

    means: Array
    J_vehicle: Array | None = None
    J_landmark: Array | None = None


@dataclass(frozen=True)
class Marginalization(Operation[None]):
    """Some landmarks leave the error state.

    Attributes
    ----------
    keys : ndarray of int64, (m,)
    gone : ndarray of bool, (n,)
        Which slots they leave.
    positions : callable
        Gives the :class:`WorldPositions` of the m landmarks as they stood. Only the backward pass
        asks, so that a step of the filter need not work them out.
    """

    keys: Keys
    gone: NDArray[np.bool_]
    positions: Callable[[], WorldPositions]

    def forward(self, state: ErrorState) -> None:
        """Leave out their rows and columns."""
        landmarks = state.rows_of(np.flatnonzero(~self.gone)).ravel()
        rows = np.concatenate([np.arange(state.vehicle_size), landmarks])
        state.covariance = marginal(state.covariance, rows, state.scratch)
