# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""World-frame landmarks whose covariances are kept one by one, without correlations.

The report's landmarks m (eq. 2 and 40), initialized by eq. 4-5.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.settings import WorldLandmarkSettings
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.landmarks import LandmarkStore
from vislam_ros.core.motion import Increment, propagate, symmetrized
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import is_member

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IndependentLandmarkSettings(WorldLandmarkSettings):
    """Settings of filters over independent landmarks."""

    planar: bool = setting(
        False,
        "Keep every landmark at z = 0 and estimate x and y, as the report's mapping does",
    )


class IndependentLandmarks:
    """The tracked landmarks of a filter, and those it has marginalized.

    Attributes
    ----------
    keys : ndarray of int64, (n,)
    means : ndarray, (n, 3)
        World positions, metres.
    covariances : ndarray, (n, 3, 3)
    """

    def __init__(self, settings: IndependentLandmarkSettings, observation: StereoObservation):
        self._settings = settings
        self._observation = observation
        self._marginalized = LandmarkStore()
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.means: Array = np.empty((0, 3))
        self.covariances: Array = np.empty((0, 3, 3))

    @property
    def count(self) -> int:
        """Number of landmarks, marginalized ones included."""
        return self._marginalized.count + len(self.keys)

    def change(
        self, settings: IndependentLandmarkSettings, observation: StereoObservation
    ) -> None:
        """Take other settings and another model of the observations."""
        self._settings, self._observation = settings, observation

    def has_depth(self, pixels: Array) -> NDArray[np.bool_]:
        """Tell which observations (n, 4) have disparity enough for a position."""
        return pixels[:, 0] - pixels[:, 2] >= self._settings.min_disparity

    def marginalize(self, keys: Keys) -> None:
        """Keep landmarks as they stand; they are corrected no more."""
        gone = is_member(self.keys, keys)
        self._marginalized.add(self.keys[gone], self.means[gone], self.covariances[gone])
        self.keys, self.means = self.keys[~gone], self.means[~gone]
        self.covariances = self.covariances[~gone]

    def initialize(
        self, keys: Keys, pixels: Array, T_world_body: Array, pose_covariance: Array
    ) -> None:
        """Add landmarks at their first observation (eq. 4-5).

        With ``landmark_initialization: correlated`` the pose's covariance adds to theirs, though
        not the correlation, which this filter cannot hold.
        """
        means, J_pose, covariances = self._observation.invert(T_world_body, pixels)
        if self._settings.landmark_initialization == "correlated":
            covariances = covariances + J_pose @ pose_covariance @ np.swapaxes(J_pose, -1, -2)
        else:
            prior = self._settings.landmark_prior_variance * np.eye(3)
            covariances = np.broadcast_to(prior, (len(keys), 3, 3))
        if self._settings.planar:
            means[:, 2] = 0.0
            in_plane = np.array([1.0, 1.0, 0.0])
            covariances = covariances * np.outer(in_plane, in_plane)
        self.keys = np.concatenate([self.keys, keys])
        self.means = np.concatenate([self.means, means])
        self.covariances = np.concatenate([self.covariances, covariances])

    def all(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), means (M, 3) and covariances (M, 3, 3), marginalized ones included."""
        keys, means, covariances = self._marginalized.all()
        return (
            np.concatenate([keys, self.keys]),
            np.concatenate([means, self.means]),
            np.concatenate([covariances, self.covariances]),
        )


class IndependentLandmarkFilter:
    """What filters over independent landmarks share: all but the correction.

    Parameters
    ----------
    settings : IndependentLandmarkSettings
    camera : StereoCamera

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    pose_covariance : ndarray, (6, 6)
        Of the pose error ``[rho; theta]`` on the right.
    """

    def __init__(self, settings: IndependentLandmarkSettings, camera: StereoCamera):
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
        """Number of landmarks, marginalized ones included."""
        return self._landmarks.count

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Predict (eq. 51-52), marginalize, correct and initialize."""
        landmarks = self._landmarks
        self.T_world_body = self.T_world_body @ increment.T
        self.pose_covariance = symmetrized(propagate(self.pose_covariance, increment))
        landmarks.marginalize(frame.ended)
        known = is_member(frame.keys, landmarks.keys)
        usable = landmarks.has_depth(frame.pixels)
        seen, new = known & usable, ~known & usable
        outcome = self._correct(frame.keys[seen], frame.pixels[seen])
        landmarks.marginalize(outcome.rejected)
        landmarks.initialize(
            frame.keys[new],
            frame.pixels[new],
            self.T_world_body,
            self._initialization_covariance(),
        )
        return replace(outcome, admitted=int(new.sum()))

    def change_settings(self, settings: IndependentLandmarkSettings) -> None:
        """Take other settings."""
        self._settings = settings
        self._observation = StereoObservation(self._observation.camera, settings.pixel_variance)
        self._landmarks.change(settings, self._observation)

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        return self._landmarks.all()

    def _correct(self, keys: Keys, pixels: Array) -> Outcome:
        """Correct by the observations (n, 4) of tracked landmarks (n,)."""
        raise NotImplementedError

    def _initialization_covariance(self) -> Array:
        """Covariance (6, 6) of the pose, as far as it is part of a new landmark's."""
        return self.pose_covariance
