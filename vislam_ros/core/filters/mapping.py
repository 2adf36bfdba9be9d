# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's mapping-only EKF (eq. 7-9 and 43-47): landmarks from poses that count as true."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.independent_landmarks import (
    IndependentLandmarkFilter,
    IndependentLandmarkSettings,
)
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.linalg.gating import mahalanobis_squared, passes_gates
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import Keys
from vislam_ros.core.tracking.tracks import indices_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MappingSettings(IndependentLandmarkSettings):
    """Settings of the mapping filter."""

    estimator: str = setting("mapping", "Which filter runs")


class MappingFilter(IndependentLandmarkFilter):
    """One small EKF a landmark: with the pose given, landmarks do not depend on each other.

    With ``planar`` a landmark has no height: it stays at z = 0 with variance 0, so that its gain
    in z is 0 and only x and y are estimated.
    """

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        landmarks = self._landmarks
        slots = indices_of(keys, landmarks.keys)
        predicted = self._observation.predict(self.T_world_body, landmarks.means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        P, H = landmarks.covariances[slots], predicted.H_landmark
        HP = H @ P
        S = HP @ np.swapaxes(H, -1, -2) + self._observation.noise
        inliers = predicted.visible & passes_gates(
            residual, S, self._settings.chi2_gate, self._settings.pixel_gate
        )
        slots, residual, S, HP = slots[inliers], residual[inliers], S[inliers], HP[inliers]
        gain = np.swapaxes(np.linalg.solve(S, HP), -1, -2)
        landmarks.means[slots] += (gain @ residual[..., None])[..., 0]
        landmarks.covariances[slots] = symmetrized(P[inliers] - gain @ HP)
        nis = float(mahalanobis_squared(residual, S).sum())
        return Outcome(len(slots), rejected=keys[~inliers], nis=nis, nis_dof=residual.size)

    def _initialization_covariance(self) -> Array:
        # The pose counts as true here.
        return np.zeros((6, 6))


register_estimator(
    "mapping",
    MappingSettings,
    lambda settings, given: MappingFilter(settings, given.camera),
)
