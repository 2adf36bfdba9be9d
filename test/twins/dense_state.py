# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The dense state of the plain robocentric filter: all variables that there ever were, kept."""

import numpy as np
from numpy.typing import NDArray
from plain_belief import Told
from plain_image_points import Complex, complex_step, shift, twist_matrix, world_positions
from scipy.linalg import expm

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

S = 19
POSE, TWIST, BIAS, LENS = slice(0, 6), slice(6, 12), slice(12, 15), 15
DRIFT = slice(16, 19)


class DenseState:
    """Estimate and covariance (D, D) of ``[vehicle; delta_1; ...; delta_N]``.

    Parameters
    ----------
    camera : StereoCamera
    variances : ndarray, (19,)
        Of the vehicle state at first.
    """

    def __init__(self, camera: StereoCamera, variances: Array):
        self.camera = camera
        self.T_world_body = np.eye(4)
        self.P: Array = np.diag(variances)
        # Estimates of all but the pose; of a clone the error.
        self.estimate = np.zeros(S)
        # First rows of the landmarks that the motion warps.
        self.warped_places: list[int] = []
        self.place_of_key: dict[int, int] = {}
        self.positions_of_key: dict[int, int] = {}
        # Position and covariance as they are told when a landmark is marginalized.
        self.mapped: dict[int, tuple[Array, Array]] = {}
        self.clones: list[tuple[Array, int]] = []

    def update(self, H: Array, R: Array, residual: Array) -> None:
        """Update by the textbook, with Joseph's form of the covariance."""
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        delta = K @ residual
        rest = np.eye(len(self.P)) - K @ H
        P = rest @ self.P @ rest.T + K @ R @ K.T
        self.P = 0.5 * (P + P.T)
        self.take_out(delta)

    def take_out(self, delta: Array) -> None:
        """Take an error out of the estimate."""
        self.T_world_body = self.T_world_body @ se3.exp(delta[POSE])
        rows = self.rows_of(self.warped_places)
        shifted = shift(self.camera, self.estimate[rows]).real
        self.estimate = self.estimate + delta
        self.estimate[rows] += delta[LENS] * shifted
        self.estimate[POSE] = 0.0

    def augment(self, J: Array, noise: Array, estimate: Array) -> None:
        """Add variables that are ``J vehicle + noise`` at present."""
        cross = J @ self.P[:S]
        self.P = np.block([[self.P, cross.T], [cross, cross[:, :S] @ J.T + noise]])
        self.estimate = np.concatenate([self.estimate, estimate])

    def has_position(self, place: int) -> bool:
        """Whether a landmark's disparity is positive by two standard deviations."""
        straight = self.estimate[place : place + 3]
        a = np.array([1.0, -1.0])
        variance = a @ self.P[place : place + 2, place : place + 2] @ a
        return bool(straight[0] - straight[1] > 2 * np.sqrt(variance))

    def position(self, y: Array, T_world_body: Array) -> tuple[Array, Array]:
        """World position (3,) of an image point, its derivative (3, 22) by vehicle and itself."""
        D = shift(self.camera, y[None])[0].real

        def moved(x: Complex) -> Complex:
            T = T_world_body @ expm(twist_matrix(x[POSE]))
            return world_positions(self.camera, T, (y + x[S:] + x[LENS] * D)[None])[0]

        return moved(np.zeros(S + 3)).real, complex_step(moved, np.zeros(S + 3))

    def active_rows(self, keys: list[int]) -> NDArray[np.int64]:
        """Rows (19 + 3 n,) of the vehicle state and these landmarks."""
        landmarks = self.rows_of([self.place_of_key[key] for key in keys])
        return np.concatenate([np.arange(S), landmarks.ravel()])

    @staticmethod
    def rows_of(places: list[int]) -> NDArray[np.int64]:
        """Rows (n, 3) of landmarks."""
        return np.array(places, dtype=np.int64).reshape(-1, 1) + np.arange(3)

    def told_pose(self, told: Told) -> Array:
        return self.T_world_body @ se3.exp(told.mean[POSE])

    def landmark(self, key: int, told: Told) -> tuple[Array, Array]:
        """World position (3,) and covariance (3, 3) as all frames so far have it."""
        if key in self.place_of_key:
            place = self.place_of_key[key]
            own = place + np.arange(3)
            y = self.estimate[own]
            y = y + told.mean[own] + told.mean[LENS] * shift(self.camera, y[None])[0].real
            position, J = self.position(y, self.told_pose(told))
            rows = np.concatenate([np.arange(S), own])
            return position, J @ told.covariance[np.ix_(rows, rows)] @ J.T
        own = self.positions_of_key[key] + np.arange(3)
        return self.estimate[own] + told.mean[own], told.within[np.ix_(own, own)]

    def smoothed(self, told: Told) -> tuple[Array, Array]:
        """Past poses (T, 4, 4) and covariances (T, 6, 6) as all frames so far have them."""
        rows = [np.arange(i, i + 6) for _, i in self.clones]
        poses = [
            T @ se3.exp(self.estimate[own] + told.mean[own])
            for (T, _), own in zip(self.clones, rows, strict=True)
        ]
        return np.array(poses), np.array([told.within[np.ix_(own, own)] for own in rows])
