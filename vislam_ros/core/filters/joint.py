# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's joint EKF (eq. 62-71): pose and world-frame landmarks with all correlations.

The dense block holds the pose and the landmarks that are tracked now. A landmark whose track has
ended can no longer be observed, so it no longer matters to the pose: it is set aside as it
stands, and the pose estimate stays that of the filter over all landmarks.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.filters.settings import WorldLandmarkSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import PredictedObservation, StereoObservation
from vislam_ros.core.landmarks import LandmarkStore
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.linalg.linear_update import correct, diagonal_blocks
from vislam_ros.core.motion import Increment, symmetrized
from vislam_ros.core.settings import setting
from vislam_ros.core.smoothing.error_operations import (
    Admission,
    Correction,
    PoseMark,
    RandomWalk,
    Retirement,
    Transition,
    landmark_rows,
)
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import among, slots_of

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
    tape : Tape, optional
        Where to record for the backward pass.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    covariance : ndarray, (6 + 3 n, 6 + 3 n)
    keys : ndarray of int64, (n,)
        The active landmarks.
    means : ndarray, (n, 3)
        Their world positions, metres.
    """

    SMALL_SIZE = 6

    def __init__(self, settings: JointSettings, camera: StereoCamera, tape: Tape | None = None):
        self._settings = settings
        self._tape = tape
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._retired = LandmarkStore()
        self.T_world_body = np.eye(4)
        self.covariance: Array = settings.prior_pose_variance * np.eye(6)
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.means: Array = np.empty((0, 3))

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self.covariance[:6, :6].copy()

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block."""
        return len(self.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks, set aside ones included."""
        return self._retired.count + len(self.keys)

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Predict (eq. 64-67), retire, correct (eq. 68-71) and admit."""
        if self._tape is not None:
            self._tape.begin_step(self.covariance)
        self._predict(increment)
        self._retire(frame.ended)
        known = among(frame.keys, self.keys)
        usable = self._has_depth(frame.pixels)
        used, rejected, nis, dof = self._correct(
            frame.keys[known & usable], frame.pixels[known & usable]
        )
        self._retire(rejected)
        self._admit(frame.keys[~known & usable], frame.pixels[~known & usable])
        if self._tape is not None:
            self._tape.record(PoseMark(self.T_world_body))
        return Outcome(used, int(np.sum(~known & usable)), rejected, nis, dof)

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._retired.all()
        return (
            np.concatenate([keys, self.keys]),
            np.concatenate([means, self.means]),
            np.concatenate([covariances, self._landmark_covariances()]),
        )

    def _landmark_covariances(self) -> Array:
        return diagonal_blocks(self.covariance[6:, 6:], 3)

    def _has_depth(self, pixels: Array) -> NDArray[np.bool_]:
        return pixels[:, 0] - pixels[:, 2] >= self._settings.min_disparity

    def _predict(self, increment: Increment) -> None:
        F = increment.transition
        P = self.covariance
        self.T_world_body = self.T_world_body @ increment.T
        P[:6, :6] = F @ P[:6, :6] @ F.T + increment.covariance
        P[:6, 6:] = F @ P[:6, 6:]
        P[6:, :6] = P[:6, 6:].T
        if self._tape is not None:
            self._tape.record(Transition(F))
            self._tape.record(RandomWalk(increment.covariance))

    def _retire(self, keys: Keys) -> None:
        gone = among(self.keys, keys)
        if not np.any(gone):
            return
        self._retired.add(self.keys[gone], self.means[gone], self._landmark_covariances()[gone])
        if self._tape is not None:
            self._tape.record(Retirement(self.keys[gone], self.means[gone], gone))
        self.keys, self.means = self.keys[~gone], self.means[~gone]
        kept = np.concatenate([np.ones(6, dtype=bool), np.repeat(~gone, 3)])
        self.covariance = self.covariance[np.ix_(kept, kept)]

    def _correct(self, keys: Keys, pixels: Array) -> tuple[int, Keys, float, int]:
        """Correct by the observations of active landmarks that pass the gates.

        Returns
        -------
        used : int
            Observations that corrected the state.
        rejected : ndarray of int64
            Keys of the others.
        nis : float
        nis_dof : int
        """
        if not len(keys):
            return 0, keys, 0.0, 0
        slots = slots_of(keys, self.keys)
        predicted = self._observation.predict(self.T_world_body, self.means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        HP = self._times_H(predicted, slots)
        S = self._innovation_covariance(HP, predicted, slots)
        n, r = residual.shape
        blocks = S.reshape(n, r, n, r)[np.arange(n), :, np.arange(n), :]
        passed = predicted.visible & passes_gates(
            residual, blocks, self._settings.chi2_gate, self._settings.pixel_gate
        )
        if not np.any(passed):
            return 0, keys, 0.0, 0
        rows = np.repeat(passed, r)
        try:
            delta, nis = correct(
                self.covariance, S[np.ix_(rows, rows)], HP[rows], residual[passed].ravel()
            )
        except scipy.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            return 0, keys, 0.0, 0
        self.T_world_body = self.T_world_body @ se3.exp(delta[:6])
        self.means = self.means + delta[6:].reshape(-1, 3)
        if self._tape is not None:
            H_pose, H_landmark = predicted.H_pose[passed], predicted.H_landmark[passed]
            noise = self._observation.noise
            self._tape.record(
                Correction(residual[passed], noise, H_pose, H_landmark, slots[passed])
            )
        return int(passed.sum()), keys[~passed], nis, residual[passed].size

    def _times_H(self, predicted: PredictedObservation, slots: NDArray[np.int64]) -> Array:
        """Return H P (n r, 6 + 3 m) without multiplying by the zeros of H."""
        P = self.covariance
        landmark_rows = P[6:].reshape(-1, 3, len(P))[slots]
        HP = predicted.H_pose @ P[:6] + predicted.H_landmark @ landmark_rows
        return HP.reshape(-1, len(P))

    def _innovation_covariance(
        self, HP: Array, predicted: PredictedObservation, slots: NDArray[np.int64]
    ) -> Array:
        """Return S = H (H P)^T + R (n r, n r), again without the zeros."""
        n, r, _ = predicted.H_pose.shape
        columns = HP.T[landmark_rows(slots, 6).ravel()].reshape(n, 3, n * r)
        S = (predicted.H_landmark @ columns).reshape(n * r, n * r)
        S += predicted.H_pose.reshape(n * r, 6) @ HP.T[:6]
        blocks = S.reshape(n, r, n, r)
        blocks[np.arange(n), :, np.arange(n), :] += self._observation.noise
        return S

    def _admit(self, keys: Keys, pixels: Array) -> None:
        """Add landmarks seen for the first time."""
        if not len(keys):
            return
        positions, J_pose, noise = self._observation.invert(self.T_world_body, pixels)
        P = self.covariance
        size, added = len(P), 3 * len(keys)
        grown = np.zeros((size + added, size + added))
        grown[:size, :size] = P
        correlated = self._settings.landmark_initialization == "correlated"
        if correlated:
            J = J_pose.reshape(added, 6)
            cross = J @ P[:6]
            new = cross[:, :6] @ J.T
            grown[size:, :size] = cross
            grown[:size, size:] = cross.T
        else:
            new = np.zeros((added, added))
            noise = np.broadcast_to(
                self._settings.landmark_prior_variance * np.eye(3), (len(keys), 3, 3)
            )
        n = len(keys)
        new.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :] += noise
        grown[size:, size:] = symmetrized(new)
        self.covariance = grown
        if self._tape is not None:
            self._tape.record(Admission(noise, J_pose if correlated else None))
        self.keys = np.concatenate([self.keys, keys])
        self.means = np.concatenate([self.means, positions])


register_estimator(
    "joint",
    JointSettings,
    lambda settings, given: JointFilter(settings, given.camera, given.tape),
    vehicle_size=JointFilter.SMALL_SIZE,
)
