# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's joint EKF (eq. 19-24 and 62-71): pose and world-frame landmarks, all correlated.

A step from stamp k - 1 to k:

1. The pose moves by the predicted motion, ``T <- T Exp(tau u)``, and landmarks stay (eq. 64-67).
2. Landmarks whose track has ended can no longer be observed, so they no longer matter to the pose:
   they are marginalized as they stand, and the pose estimate stays that of the filter over all
   landmarks.
3. The observations of known landmarks correct everything (eq. 46-47, 58 and 68-71, with the gain
   of eq. 73). Landmarks whose observation fails a gate are marginalized too.
4. Landmarks seen for the first time are initialized (eq. 4-5), with their correlation to the pose
   or, as the report does, without.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.filters.settings import WorldLandmarkSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.landmarks import LandmarkStore
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.motion import Increment
from vislam_ros.core.operations.correction import Correction
from vislam_ros.core.operations.error_state import ErrorState, Recorder
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization, WorldPositions
from vislam_ros.core.operations.transition import RandomWalk, VehicleTransition
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import indices_of, is_member

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointSettings(WorldLandmarkSettings):
    """Settings of the joint filter."""

    estimator: str = setting("joint", "Which filter runs")


class JointFilter:
    """EKF over the error state ``[xi; delta m_1; ...; delta m_n]``, pose first.

    Parameters
    ----------
    settings : JointSettings
    camera : StereoCamera
    tape : Recorder, optional
        Where to record for the backward pass.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    keys : ndarray of int64, (n,)
        The active landmarks.
    means : ndarray, (n, 3)
        Their world positions, metres.
    """

    def __init__(
        self, settings: JointSettings, camera: StereoCamera, tape: Recorder | None = None
    ):
        self._settings = settings
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._state = ErrorState(settings.prior_pose_variance * np.eye(6), 6, tape)
        self._marginalized = LandmarkStore()
        self.T_world_body = np.eye(4)
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.means: Array = np.empty((0, 3))

    @property
    def covariance(self) -> Array:
        """Covariance (6 + 3 n, 6 + 3 n) of the error state."""
        return self._state.covariance

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self._state.vehicle_covariance.copy()

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block."""
        return len(self.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks, marginalized ones included."""
        return self._marginalized.count + len(self.keys)

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Predict, marginalize, correct and initialize."""
        self._predict(increment)
        self._marginalize(frame.ended)
        known = is_member(frame.keys, self.keys)
        usable = self._has_depth(frame.pixels)
        seen, new = known & usable, ~known & usable
        outcome = self._correct(frame.keys[seen], frame.pixels[seen])
        self._marginalize(outcome.rejected)
        self._initialize(frame.keys[new], frame.pixels[new])
        self._state.end_step(self.T_world_body)
        return replace(outcome, admitted=int(np.count_nonzero(new)))

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._marginalized.all()
        return (
            np.concatenate([keys, self.keys]),
            np.concatenate([means, self.means]),
            np.concatenate([covariances, self._state.landmark_covariances()]),
        )

    def change_settings(self, settings: JointSettings) -> None:
        """Take other settings."""
        self._settings = settings
        self._observation = StereoObservation(self._observation.camera, settings.pixel_variance)

    def _has_depth(self, pixels: Array) -> NDArray[np.bool_]:
        return pixels[:, 0] - pixels[:, 2] >= self._settings.min_disparity

    def _predict(self, increment: Increment) -> None:
        """Move the pose (eq. 64); ``P <- F P F^T + W`` (eq. 65-67)."""
        self.T_world_body = self.T_world_body @ increment.T
        self._state.apply(VehicleTransition(increment.transition))
        self._state.apply(RandomWalk(increment.covariance))

    def _marginalize(self, keys: Keys) -> None:
        """Leave landmarks out of the state as they stand."""
        gone = is_member(self.keys, keys)
        if not np.any(gone):
            return
        keys, means = self.keys[gone], self.means[gone]
        self._marginalized.add(keys, means, self._state.landmark_covariances()[gone])
        self._state.apply(Marginalization(keys, gone, partial(WorldPositions, means)))
        self.keys, self.means = self.keys[~gone], self.means[~gone]

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        """Correct by the observations of active landmarks that pass the gates (eq. 68-71)."""
        if not len(keys):
            return Outcome()
        slots = indices_of(keys, self.keys)
        predicted = self._observation.predict(self.T_world_body, self.means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        seen = Correction(
            residual, self._observation.noise, predicted.H_pose, predicted.H_landmark, slots
        )
        innovation = seen.innovation_in(self._state)
        inliers = predicted.visible & passes_gates(
            residual,
            innovation.covariances(),
            self._settings.chi2_gate,
            self._settings.pixel_gate,
        )
        if not np.any(inliers):
            return Outcome(rejected=keys)
        some = innovation.of(inliers, self._state.scratch)
        try:
            corrected = self._state.apply(seen.by(inliers, some))
        except scipy.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            return Outcome(rejected=keys)
        self.T_world_body = self.T_world_body @ se3.exp(corrected.delta[:6])
        self.means = self.means + corrected.delta[6:].reshape(-1, 3)
        return Outcome(
            used=int(np.count_nonzero(inliers)),
            rejected=keys[~inliers],
            nis=corrected.nis,
            nis_dof=residual[inliers].size,
        )

    def _initialize(self, keys: Keys, pixels: Array) -> None:
        """Add landmarks at their first observation (eq. 4-5)."""
        if not len(keys):
            return
        positions, J_pose, noise = self._observation.invert(self.T_world_body, pixels)
        if self._settings.landmark_initialization == "correlated":
            self._state.apply(Initialization(noise, J_pose))
        else:
            prior = self._settings.landmark_prior_variance * np.eye(3)
            self._state.apply(Initialization(np.broadcast_to(prior, noise.shape)))
        self.keys = np.concatenate([self.keys, keys])
        self.means = np.concatenate([self.means, positions])


register_estimator(
    "joint",
    JointSettings,
    lambda settings, given: JointFilter(settings, given.camera, given.tape),
    smoothable=True,
)
