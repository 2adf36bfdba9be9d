# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Innovations of landmarks whose own three numbers are observed, and which of them agree."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.gating import Inliers, deletion_gate, passes_gates
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState

Array = NDArray[np.float64]


class Innovations(NamedTuple):
    """Innovations of some landmarks.

    Attributes
    ----------
    slots : ndarray of int64, (n,)
        Which landmark each is of, all different.
    residual : ndarray, (n, 3)
        ``z - y``, pixels.
    noise : ndarray, (n, 3)
        Variances of the observations, square pixels.
    expected : ndarray, (n, 3)
        What they add to the covariance of an innovation where it is judged alone.
    components : ndarray of int64, (r,)
        Which of the three numbers are observed, in their order.
    chi2_gate, pixel_gate : float
        Bounds of squared Mahalanobis distances, and of each number, pixels; 0 for none.
    """

    slots: NDArray[np.int64]
    residual: Array
    noise: Array
    expected: Array
    components: NDArray[np.int64]
    chi2_gate: float
    pixel_gate: float

    def of(self, chosen: NDArray[np.int64]) -> "Innovations":
        """Return some (k,) of them."""
        return self._replace(
            slots=self.slots[chosen],
            residual=self.residual[chosen],
            noise=self.noise[chosen],
            expected=self.expected[chosen],
        )

    def agreed_in(self, state: ErrorState) -> Inliers:
        """Those that pass their own gates, and agree with each other.

        Raises
        ------
        numpy.linalg.LinAlgError
            Where a covariance is not positive.
        """
        own = state.landmark_covariances()[self.slots]
        own.reshape(-1, 9)[:, ::4] += self.expected
        alone = np.flatnonzero(passes_gates(self.residual, own, self.chi2_gate, self.pixel_gate))
        numbers = alone[:, None], self.components
        together = DirectCorrection(
            self.residual[numbers], self.noise[numbers], self.slots[alone], self.components
        )
        agreed = deletion_gate(self.chi2_gate, together.residual, together.inverse_in(state))
        return agreed._replace(indices=alone[agreed.indices])

    def covariance_in(self, state: ErrorState, rows: slice, inliers: Inliers) -> Array:
        """P_xz (k, m) of some of the vehicle's rows with the inliers' numbers."""
        seen = state.rows_of(self.slots[inliers.indices])[:, self.components].ravel()
        return state.covariance[rows][:, seen]
