# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Innovations of landmarks whose own three numbers are observed: which agree, what they show."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.gating import (
    Inliers,
    deletion_gate,
    deletion_residuals,
    passes_gates,
    without,
)
from vislam_ros.core.noise.track_runs import TrackRuns
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState, Operation

Array = NDArray[np.float64]


class Shown(NamedTuple):
    """What the innovations that agree show of a vehicle state.

    Attributes
    ----------
    delta : ndarray, (s,)
        By how much it is off.
    covariance : ndarray, (s, s)
        Of what is left of the error.
    by_most : bool
        Whether more than half of the innovations agree.
    numbers : int
        How many numbers of theirs there are.
    """

    delta: Array
    covariance: Array
    by_most: bool
    numbers: int


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

    def agreed_over_time_in(self, state: ErrorState, runs: TrackRuns) -> Inliers:
        """Those that agree with each other, and with all that their tracks had before."""
        agreed, told = self.agreed_in(state), self.components
        white = deletion_residuals(agreed, len(told))
        distances = runs.update(self.slots[agreed.indices], told, white)
        if self.chi2_gate > 0 and np.any(distances > self.chi2_gate):
            agreed = without(agreed, distances > self.chi2_gate, self.residual[:, told])
        return agreed

    def shown_after(
        self, covariance: Array, vehicle_size: int, operations: Sequence[Operation[Any]]
    ) -> Shown | None:
        """What those that agree show of the vehicle state, were it so, after some operations.

        None where a covariance is not positive. The one given (s + 3 n, s + 3 n) stays as it is.
        """
        state = ErrorState(covariance, vehicle_size)
        for operation in operations:
            state.apply(operation)
        try:
            agreed = self.agreed_in(state)
        except np.linalg.LinAlgError:
            return None
        seen = state.rows_of(self.slots[agreed.indices])[:, self.components].ravel()
        P_xz = state.covariance[:vehicle_size, seen]
        return Shown(
            P_xz @ agreed.weighted,
            state.vehicle_covariance - P_xz @ agreed.inverse @ P_xz.T,
            2 * len(agreed.indices) > len(self.slots),
            len(agreed.weighted),
        )
