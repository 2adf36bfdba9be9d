# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stereo observation of a landmark in the world: prediction, Jacobians and its inverse.

The report's observation (eq. 1, 6, 38, 42 and 55) is ``z = M pi(T_camera_body T_world_body^-1 m) +
v`` with four rows, ``v ~ N(0, V)``. Rectified images share one row, so for ``V = sigma^2 I`` the
three rows ``(u_left, u_right, (v_left + v_right) / 2)`` with noise ``sigma^2 diag(1, 1, 1/2)``
hold the same information; any other V keeps all four. Its prediction is eq. 46, its Jacobians are
eq. 47 by the landmark and eq. 56-58 by the pose (side by side in eq. 21 and 68), its inverse is
eq. 4-5.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

# (u_left, v_left, u_right, v_right) = _FOUR_ROWS @ (u_left, u_right, v)
_FOUR_ROWS = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]])
_COMPRESSION = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 0.5, 0, 0.5]])


@dataclass(frozen=True)
class PredictedObservation:
    """What the camera should see, and how that depends on the state.

    Attributes
    ----------
    z : ndarray, (n, r)
        Predicted rows, pixels.
    H_pose : ndarray, (n, r, 6)
        Derivative by the pose error ``[rho; theta]`` on the right (the report's eq. 58).
    H_landmark : ndarray, (n, r, 3)
        Derivative by the landmark's world position (the report's eq. 47).
    visible : ndarray of bool, (n,)
        Whether the landmark lies in front of the camera.
    """

    z: Array
    H_pose: Array
    H_landmark: Array
    visible: NDArray[np.bool_]


class StereoObservation:
    """Observation model of one camera and pixel noise.

    Parameters
    ----------
    camera : StereoCamera
    pixel_variance : sequence of float, (4,)
        Variances of ``u_left, v_left, u_right, v_right``, square pixels.

    Attributes
    ----------
    noise : ndarray, (r, r)
        Covariance of the model rows; r is 3 where all four variances are equal, else 4.
    """

    # A landmark nearer than this to the camera's plane has no useful projection.
    _MIN_DEPTH = 0.1

    def __init__(self, camera: StereoCamera, pixel_variance: tuple[float, ...]):
        self.camera = camera
        V = np.diag(pixel_variance)
        if len(set(pixel_variance)) == 1:
            self._rows_of_image_point = np.eye(3)
            self._rows_of_pixels = _COMPRESSION
        else:
            self._rows_of_image_point = _FOUR_ROWS
            self._rows_of_pixels = np.eye(4)
        self.noise: Array = self._rows_of_pixels @ V @ self._rows_of_pixels.T
        # Weighted least squares for the image point (u_left, u_right, v) of the four pixels.
        information = _FOUR_ROWS.T @ np.diag(1 / np.diag(V)) @ _FOUR_ROWS
        self.image_point_noise: Array = np.linalg.inv(information)
        self._row_mismatch_std = np.sqrt(pixel_variance[1] + pixel_variance[3])
        self._image_point_of_pixels = (
            self.image_point_noise @ _FOUR_ROWS.T @ np.diag(1 / np.diag(V))
        )

    def rows(self, pixels: Array) -> Array:
        """Model rows (n, r) of pixels (n, 4)."""
        return pixels @ self._rows_of_pixels.T

    def image_points(self, pixels: Array) -> Array:
        """Best image points ``(u_left, u_right, v)`` (n, 3) of pixels (n, 4)."""
        return pixels @ self._image_point_of_pixels.T

    def row_mismatch(self, pixels: Array) -> Array:
        """How far v_left and v_right (n,) of pixels (n, 4) differ, in standard deviations.

        Both are the row of one point, so the difference is noise, whatever the motion.
        """
        return (pixels[:, 1] - pixels[:, 3]) / self._row_mismatch_std

    def predict(self, T_world_body: Array, landmarks: Array) -> PredictedObservation:
        """Predict the observations of landmarks.

        Parameters
        ----------
        T_world_body : ndarray, (4, 4)
        landmarks : ndarray, (n, 3)
            World positions, metres.

        Returns
        -------
        PredictedObservation
            With zeros where a landmark is not visible.
        """
        R_camera_body = self.camera.T_camera_body[:3, :3]
        points_body = (landmarks - T_world_body[:3, 3]) @ T_world_body[:3, :3]
        points_camera = points_body @ R_camera_body.T + self.camera.T_camera_body[:3, 3]
        visible = points_camera[:, 2] > self._MIN_DEPTH
        points_camera[~visible] = (0.0, 0.0, 1.0)
        J = self._rows_of_image_point @ self.camera.project_jacobian(points_camera)
        J[~visible] = 0.0
        J_body = J @ R_camera_body
        # The body point moves by -(rho + theta x p) when the pose moves by Exp(xi).
        H_pose = np.concatenate([-J_body, J_body @ se3.hat(points_body)], axis=-1)
        H_landmark = J_body @ T_world_body[:3, :3].T
        z = self.camera.project(points_camera) @ self._rows_of_image_point.T
        return PredictedObservation(z, H_pose, H_landmark, visible)

    def invert(self, T_world_body: Array, pixels: Array) -> tuple[Array, Array, Array]:
        """Landmarks in the world from a first observation (the report's eq. 4-5).

        Parameters
        ----------
        T_world_body : ndarray, (4, 4)
        pixels : ndarray, (n, 4)
            With positive disparity.

        Returns
        -------
        positions : ndarray, (n, 3)
            Metres.
        J_pose : ndarray, (n, 3, 6)
            Derivative by the pose error on the right.
        noise : ndarray, (n, 3, 3)
            Covariance that the pixel noise gives, square metres.
        """
        y = self.image_points(pixels)
        T_body_camera = self.camera.T_body_camera
        points_body = self.camera.triangulate(y) @ T_body_camera[:3, :3].T + T_body_camera[:3, 3]
        R_world_body = T_world_body[:3, :3]
        positions = points_body @ R_world_body.T + T_world_body[:3, 3]
        J_pose = np.concatenate(
            [
                np.broadcast_to(R_world_body, (len(y), 3, 3)),
                -R_world_body @ se3.hat(points_body),
            ],
            axis=-1,
        )
        J_y = (R_world_body @ T_body_camera[:3, :3]) @ self.camera.triangulate_jacobian(y)
        noise = J_y @ self.image_point_noise @ np.swapaxes(J_y, -1, -2)
        return positions, J_pose, noise
