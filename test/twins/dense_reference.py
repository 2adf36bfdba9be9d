# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint filter in its plainest form, to measure the fast one by.

One dense covariance over the pose, every landmark ever seen and every past pose (a clone that is
never observed or moved), textbook equations and an explicit inverse: no active set, no adjoints.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.motion import Increment
from vislam_ros.core.tracking.tracked_frame import TrackedFrame

Array = NDArray[np.float64]


class DenseJointFilter:
    """EKF over ``[xi; delta_1; ...; delta_N]`` where each delta is a landmark's or a clone's."""

    def __init__(self, settings: JointSettings, camera: StereoCamera, clone_poses: bool = False):
        self.settings = settings
        self.camera = camera
        self.observation = StereoObservation(camera, settings.pixel_variance)
        self.clone_poses = clone_poses
        self.T_world_body = np.eye(4)
        self.P: Array = settings.prior_pose_variance * np.eye(6)
        # Estimates of all but the pose: world positions of landmarks, errors of clones.
        self.estimate = np.zeros(6)
        self.place_of_key: dict[int, int] = {}
        self.ended: set[int] = set()
        self.clones: list[tuple[Array, int]] = []
        self.rejected = 0

    def step(self, increment: Increment, frame: TrackedFrame) -> list[int]:
        """Take a frame; return the keys whose observations failed a gate."""
        F = np.eye(len(self.P))
        F[:6, :6] = se3.adjoint(se3.inverse(increment.T))
        self.T_world_body = self.T_world_body @ increment.T
        self.P = F @ self.P @ F.T
        self.P[:6, :6] += increment.covariance
        self.ended.update(frame.ended.tolist())
        disparity = frame.pixels[:, 0] - frame.pixels[:, 2]
        known: list[int] = []
        new: list[int] = []
        for i, key in enumerate(frame.keys.tolist()):
            if disparity[i] >= self.settings.min_disparity:
                (known if key in self.place_of_key else new).append(i)
        assert not {int(frame.keys[i]) for i in known} & self.ended
        rejected = self.correct(frame.keys[known].tolist(), frame.pixels[known]) if known else []
        self.ended.update(rejected)
        if new:
            self.initialize(frame.keys[new].tolist(), frame.pixels[new])
        if self.clone_poses:
            self.clones.append((self.T_world_body, len(self.P)))
            self.augment(np.eye(6), np.zeros((6, 6)), np.zeros(6))
        return rejected

    def correct(self, keys: list[int], pixels: Array) -> list[int]:
        means = np.array([self.landmark(key)[0] for key in keys])
        predicted = self.observation.predict(self.T_world_body, means)
        residual = self.observation.rows(pixels) - predicted.z
        n, r = residual.shape
        H: Array = np.zeros((n, r, len(self.P)))
        H[:, :, :6] = predicted.H_pose
        for i, key in enumerate(keys):
            place = self.place_of_key[key]
            H[i, :, place : place + 3] = predicted.H_landmark[i]
        noise = self.observation.noise
        own = np.array([H[i] @ self.P @ H[i].T + noise for i in range(n)])
        inliers = predicted.visible & passes_gates(
            residual, own, self.settings.chi2_gate, self.settings.pixel_gate
        )
        H = H[inliers].reshape(-1, len(self.P))
        S = H @ self.P @ H.T + np.kron(np.eye(inliers.sum()), noise)
        K = self.P @ H.T @ np.linalg.inv(S)
        delta = K @ residual[inliers].ravel()
        self.P = self.P - K @ (H @ self.P)
        self.P = 0.5 * (self.P + self.P.T)
        self.T_world_body = self.T_world_body @ se3.exp(delta[:6])
        self.estimate = self.estimate + delta
        return [key for key, good in zip(keys, inliers, strict=True) if not good]

    def initialize(self, keys: list[int], pixels: Array) -> None:
        positions, J_pose, noise = self.observation.invert(self.T_world_body, pixels)
        for i, key in enumerate(keys):
            self.place_of_key[key] = len(self.P)
            if self.settings.landmark_initialization == "correlated":
                self.augment(J_pose[i], noise[i], positions[i])
            else:
                prior = self.settings.landmark_prior_variance * np.eye(3)
                self.augment(np.zeros((3, 6)), prior, positions[i])

    def augment(self, J: Array, noise: Array, estimate: Array) -> None:
        """Add variables that are ``J xi + noise`` at present."""
        cross = J @ self.P[:6]
        self.P = np.block([[self.P, cross.T], [cross, cross[:, :6] @ J.T + noise]])
        self.estimate = np.concatenate([self.estimate, estimate])

    def landmark(self, key: int) -> tuple[Array, Array]:
        """World position (3,) and covariance (3, 3) as all frames so far have it."""
        own = slice(self.place_of_key[key], self.place_of_key[key] + 3)
        return self.estimate[own], self.P[own, own]

    def smoothed(self) -> tuple[Array, Array]:
        """Past poses (T, 4, 4) and covariances (T, 6, 6) as all frames so far have them."""
        poses = [T @ se3.exp(self.estimate[i : i + 6]) for T, i in self.clones]
        return np.array(poses), np.array([self.P[i : i + 6, i : i + 6] for _, i in self.clones])
