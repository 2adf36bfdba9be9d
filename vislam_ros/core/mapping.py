# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's mapping-only EKF (eq. 43-47): landmarks from poses that are taken as true."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.camera import StereoCamera
from vislam_ros.core.estimator import Outcome
from vislam_ros.core.gating import mahalanobis_squared, passes_gates
from vislam_ros.core.independent_landmarks import IndependentLandmarks
from vislam_ros.core.motion import Increment, propagate, symmetrized
from vislam_ros.core.observation import StereoObservation
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.tracks import Keys, TrackedFrame, slots_of

Array = NDArray[np.float64]


class MappingFilter:
    """One small EKF a landmark: with the pose given, landmarks do not depend on each other.

    With ``planar`` a landmark has no height: it stays at z = 0 with variance 0, so that its gain
    in z is 0 and only x and y are estimated.
    """

    gyro_bias = None
    gyro_bias_std = None

    def __init__(self, settings: SlamSettings, camera: StereoCamera):
        self._settings = settings
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._landmarks = IndependentLandmarks(settings, self._observation)
        self.T_world_body = np.eye(4)
        self.pose_covariance: Array = settings.prior_pose_variance * np.eye(6)

    @property
    def active(self) -> int:
        """Number of landmarks that the next frame can correct."""
        return len(self._landmarks.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks, set aside ones included."""
        return self._landmarks.count

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Move to the given pose, then correct the landmarks seen from it."""
        landmarks = self._landmarks
        self.T_world_body = self.T_world_body @ increment.T
        self.pose_covariance = symmetrized(propagate(self.pose_covariance, increment))
        landmarks.retire(frame.ended)
        known = np.isin(frame.keys, landmarks.keys)
        usable = landmarks.has_depth(frame.pixels)
        outcome = self._correct(frame.keys[known & usable], frame.pixels[known & usable])
        landmarks.retire(outcome.rejected)
        new = ~known & usable
        # The pose counts as true here, so its covariance is no part of a landmark's.
        landmarks.admit(frame.keys[new], frame.pixels[new], self.T_world_body, np.zeros((6, 6)))
        return Outcome(
            outcome.used, int(new.sum()), outcome.rejected, outcome.nis, outcome.nis_dof
        )

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        landmarks = self._landmarks
        slots = slots_of(keys, landmarks.keys)
        predicted = self._observation.predict(self.T_world_body, landmarks.means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        P, H = landmarks.covariances[slots], predicted.H_landmark
        HP = H @ P
        S = HP @ np.swapaxes(H, -1, -2) + self._observation.noise
        passed = predicted.visible & passes_gates(self._settings, residual, S)
        slots, residual, S, HP = slots[passed], residual[passed], S[passed], HP[passed]
        gain = np.swapaxes(np.linalg.solve(S, HP), -1, -2)
        landmarks.means[slots] += (gain @ residual[..., None])[..., 0]
        landmarks.covariances[slots] = symmetrized(P[passed] - gain @ HP)
        nis = float(mahalanobis_squared(residual, S).sum())
        return Outcome(len(slots), rejected=keys[~passed], nis=nis, nis_dof=residual.size)

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        return self._landmarks.all()
