# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's separated filter (eq. 20 and 72): pose and landmarks without cross-covariance.

It corrects with the joint innovation covariance (eq. 69-71) and then forgets what correlates pose
and landmarks. Without correlations every matrix is a sum of small blocks: with ``D = H_L P_L H_L^T
+ R``, one block a landmark, the innovation covariance is ``S = D + H_p Sigma H_p^T``, and the
identity of Woodbury gives all that is needed of its inverse.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.independent_landmarks import (
    IndependentLandmarkFilter,
    IndependentLandmarkSettings,
)
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.geometry import se3
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.linalg.pose_update import corrected_by_information
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import Keys
from vislam_ros.core.tracking.tracks import indices_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BlockDiagonalSettings(IndependentLandmarkSettings):
    """Settings of the block diagonal filter."""

    estimator: str = setting("block_diagonal", "Which filter runs")


class BlockDiagonalFilter(IndependentLandmarkFilter):
    """EKF with C = 0. It is overconfident: the report keeps C for that reason."""

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        landmarks = self._landmarks
        slots = indices_of(keys, landmarks.keys)
        predicted = self._observation.predict(self.T_world_body, landmarks.means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        H_p, H_L, P = predicted.H_pose, predicted.H_landmark, landmarks.covariances[slots]
        Sigma = self.pose_covariance
        D = H_L @ P @ np.swapaxes(H_L, -1, -2) + self._observation.noise
        S_blocks = D + H_p @ Sigma @ np.swapaxes(H_p, -1, -2)
        inliers = predicted.visible & passes_gates(
            residual, S_blocks, self._settings.chi2_gate, self._settings.pixel_gate
        )
        slots, residual, D = slots[inliers], residual[inliers, :, None], D[inliers]
        H_p, H_L, P = H_p[inliers], H_L[inliers], P[inliers]

        D_inverse_H_p = np.linalg.solve(D, H_p)
        D_inverse_r = np.linalg.solve(D, residual)
        information = np.einsum("nri,nrj->ij", H_p, D_inverse_H_p)
        Sigma_plus = corrected_by_information(Sigma, symmetrized(information))
        delta_pose = Sigma_plus @ np.einsum("nri,nrk->i", H_p, D_inverse_r)

        # Rows of S^-1 r and diagonal blocks of S^-1, by Woodbury.
        S_inverse_r = D_inverse_r - (D_inverse_H_p @ delta_pose)[..., None]
        S_inverse = np.linalg.inv(D) - D_inverse_H_p @ Sigma_plus @ np.swapaxes(
            D_inverse_H_p, -1, -2
        )
        HP = H_L @ P
        landmarks.means[slots] += (np.swapaxes(HP, -1, -2) @ S_inverse_r)[..., 0]
        landmarks.covariances[slots] = symmetrized(P - np.swapaxes(HP, -1, -2) @ S_inverse @ HP)
        self.T_world_body = self.T_world_body @ se3.exp(delta_pose)
        self.pose_covariance = Sigma_plus
        nis = float(np.sum(residual * S_inverse_r))
        return Outcome(len(slots), rejected=keys[~inliers], nis=nis, nis_dof=residual.size)


register_estimator(
    "block_diagonal",
    BlockDiagonalSettings,
    lambda settings, given: BlockDiagonalFilter(settings, given.camera),
)
