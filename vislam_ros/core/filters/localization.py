# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's pose-only EKF (eq. 16-18 and 55-61) on a map that counts as true."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.registry import Surroundings, register_estimator
from vislam_ros.core.filters.settings import GivenMapSettings, ObservationSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.linalg.gating import mahalanobis_squared, passes_gates
from vislam_ros.core.linalg.pose_update import corrected_by_information
from vislam_ros.core.motion import Increment, propagate, symmetrized
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LocalizationSettings(ObservationSettings, GivenMapSettings):
    """Settings of the localization on a given map."""

    estimator: str = setting("localization", "Which filter runs")


class LocalizationFilter:
    """EKF over the pose alone.

    One id may stand for several landmarks of the map, as it has begun anew in the drive that
    made the map; an observation is compared with all of them and the nearest is taken.

    Parameters
    ----------
    settings : LocalizationSettings
    camera : StereoCamera
    given_map : LandmarkMap
    ids_of_keys : callable
        Gives the track ids (n,) of keys (n,).
    """

    def __init__(
        self,
        settings: LocalizationSettings,
        camera: StereoCamera,
        given_map: LandmarkMap,
        ids_of_keys: Callable[[Keys], NDArray[np.uint32]],
    ):
        self._settings = settings
        self._observation = StereoObservation(camera, settings.pixel_variance)
        order = np.argsort(given_map.ids, kind="stable")
        self._ids = given_map.ids[order]
        self._means = given_map.positions[order]
        self._covariances = given_map.covariances[order]
        self._ids_of_keys = ids_of_keys
        self._visible = 0
        self.T_world_body = np.eye(4)
        self.pose_covariance: Array = settings.prior_pose_variance * np.eye(6)

    @property
    def active(self) -> int:
        """Number of landmarks of the map that the last frame could be compared with."""
        return self._visible

    @property
    def landmark_count(self) -> int:
        """Number of landmarks of the map."""
        return len(self._ids)

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Predict the pose (eq. 51-52), then correct it by what is seen of the map (eq. 59-61)."""
        self.T_world_body = self.T_world_body @ increment.T
        self.pose_covariance = symmetrized(propagate(self.pose_covariance, increment))
        # A copied pixel says nothing of the new pose.
        if frame.frozen:
            return Outcome()
        ids = self._ids_of_keys(frame.keys)
        first = np.searchsorted(self._ids, ids, side="left")
        count = np.searchsorted(self._ids, ids, side="right") - first
        observation = np.repeat(np.arange(len(ids)), count)
        within = np.arange(len(observation)) - np.repeat(np.cumsum(count) - count, count)
        candidate = np.repeat(first, count) + within

        predicted = self._observation.predict(self.T_world_body, self._means[candidate])
        residual = self._observation.rows(frame.pixels)[observation] - predicted.z
        H = predicted.H_pose
        S = H @ self.pose_covariance @ np.swapaxes(H, -1, -2) + self._observation.noise
        distance = np.where(predicted.visible, mahalanobis_squared(residual, S), np.inf)
        # The nearest candidate of each observation: sort by observation, then by distance.
        order = np.lexsort([distance, observation])
        best = order[np.unique(observation, return_index=True)[1]]
        inliers = predicted.visible[best] & passes_gates(
            residual[best], S[best], self._settings.chi2_gate, self._settings.pixel_gate
        )
        used = best[inliers]
        self._visible = int(predicted.visible[best].sum())

        H, residual = H[used], residual[used, :, None]
        R_inverse = np.linalg.inv(self._observation.noise)
        weighted = np.swapaxes(H, -1, -2) @ R_inverse
        information = symmetrized((weighted @ H).sum(axis=0))
        Sigma_plus = corrected_by_information(self.pose_covariance, information)
        gradient = (weighted @ residual).sum(axis=0)[:, 0]
        delta = Sigma_plus @ gradient
        nis = float(np.sum(residual * (R_inverse @ residual)) - gradient @ delta)
        self.T_world_body = self.T_world_body @ se3.exp(delta)
        self.pose_covariance = Sigma_plus
        return Outcome(
            used=len(used),
            rejected=frame.keys[observation[best[~inliers]]],
            nis=nis,
            nis_dof=residual.size,
        )

    def change_settings(self, settings: LocalizationSettings) -> None:
        """Take other settings."""
        self._settings = settings
        self._observation = StereoObservation(self._observation.camera, settings.pixel_variance)

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys -1 (M,), world positions (M, 3) and covariances (M, 3, 3) of the given map."""
        return np.full(len(self._ids), -1), self._means, self._covariances


def _on_given_map(settings: LocalizationSettings, given: Surroundings) -> LocalizationFilter:
    assert given.given_map is not None
    return LocalizationFilter(settings, given.camera, given.given_map, given.ids_of_keys)


register_estimator(
    "localization",
    LocalizationSettings,
    _on_given_map,
    # A landmark of the map is not set aside.
    unused=("retire_after", "rest_after_rejection"),
)
