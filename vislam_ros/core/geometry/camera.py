# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A rectified stereo camera and its three-row image point ``y = (u_left, u_right, v)``.

Both images share one row, so the four pixels of an observation (the report's eq. 4) hold three
numbers. For a point ``p = (x, y, z)`` in the left camera, the report's ``M pi(q)`` (eq. 39 and 41)
is ::

    u_left  = fx x / z + cx
    u_right = (fx x - fx b) / z + cx
    v       = fy y / z + cy
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]


def pixels_of(y: Array) -> Array:
    """Pixels ``u_left, v_left, u_right, v_right`` (..., 4) of image points (..., 3)."""
    return y[..., [0, 2, 1, 2]]


def image_points_of(pixels: NDArray[np.floating]) -> Array:
    """Image points (..., 3) of pixels (..., 4), the mean of both rows being theirs."""
    rows = 0.5 * (pixels[..., 1] + pixels[..., 3])
    return np.stack([pixels[..., 0], pixels[..., 2], rows], axis=-1).astype(float)


@dataclass(frozen=True)
class StereoCamera:
    """Calibration of a rectified stereo pair on a body.

    The fields are the very numbers that CameraInfo and TransformStamped messages carry, so a
    camera that went through a bag or a topic equals the one that was sent, to the last bit.

    Attributes
    ----------
    fx, fy : float
        Focal lengths of both cameras, pixels.
    cx, cy : float
        Principal point of both cameras, pixels.
    fx_baseline : float
        Focal length times baseline (``-P_right[0, 3]``), pixels times metres.
    position_body_camera : tuple of float, (3,)
        Left camera's centre in the body, metres.
    quaternion_body_camera : tuple of float, (4,)
        Rotation from left optical axes to body axes, x, y, z, w.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    fx_baseline: float
    position_body_camera: tuple[float, float, float]
    quaternion_body_camera: tuple[float, float, float, float]

    @classmethod
    def from_matrices(
        cls, K: ArrayLike, baseline: float, T_body_camera: ArrayLike
    ) -> "StereoCamera":
        """Build a camera from its (3, 3) intrinsics, baseline in metres and (4, 4) extrinsics.

        The rotation is made orthonormal once: files store it to about 1e-8 only.
        """
        K = np.asarray(K, dtype=float)
        T = np.asarray(T_body_camera, dtype=float)
        quaternion = se3.quaternion_from_rotation(se3.nearest_rotation(T[:3, :3]))
        return cls(
            fx=float(K[0, 0]),
            fy=float(K[1, 1]),
            cx=float(K[0, 2]),
            cy=float(K[1, 2]),
            fx_baseline=float(K[0, 0]) * float(baseline),
            position_body_camera=(float(T[0, 3]), float(T[1, 3]), float(T[2, 3])),
            quaternion_body_camera=(
                float(quaternion[0]),
                float(quaternion[1]),
                float(quaternion[2]),
                float(quaternion[3]),
            ),
        )

    @property
    def baseline(self) -> float:
        """Distance between the cameras, metres."""
        return self.fx_baseline / self.fx

    @cached_property
    def T_body_camera(self) -> Array:
        """Pose (4, 4) of the left optical frame in the body frame."""
        return se3.pose_matrix(self.position_body_camera, self.quaternion_body_camera)

    @cached_property
    def T_camera_body(self) -> Array:
        """Pose (4, 4) of the body frame in the left optical frame."""
        return se3.inverse(self.T_body_camera)

    @cached_property
    def camera_from_body_twist(self) -> Array:
        """Adjoint (6, 6) of ``T_camera_body``: a body twist in camera axes."""
        return se3.adjoint(self.T_camera_body)

    def project(self, points_camera: ArrayLike) -> Array:
        """Image points of points in the left camera.

        Parameters
        ----------
        points_camera : array_like, (..., 3)
            Metres. A depth of zero gives infinities, as it should; mask it before.

        Returns
        -------
        ndarray, (..., 3)
            ``(u_left, u_right, v)``, pixels.
        """
        p = np.asarray(points_camera, dtype=float)
        y = np.empty_like(p)
        inverse_depth = 1.0 / p[..., 2]
        y[..., 0] = self.fx * p[..., 0] * inverse_depth + self.cx
        y[..., 1] = y[..., 0] - self.fx_baseline * inverse_depth
        y[..., 2] = self.fy * p[..., 1] * inverse_depth + self.cy
        return y

    def project_jacobian(self, points_camera: ArrayLike) -> Array:
        """Derivative (..., 3, 3) of :meth:`project` by the point (eq. 41), pixels per metre."""
        p = np.asarray(points_camera, dtype=float)
        w = 1.0 / p[..., 2]
        J = np.zeros((*p.shape, 3))
        J[..., 0, 0] = J[..., 1, 0] = self.fx * w
        J[..., 0, 2] = -self.fx * p[..., 0] * w**2
        J[..., 1, 2] = J[..., 0, 2] + self.fx_baseline * w**2
        J[..., 2, 1] = self.fy * w
        J[..., 2, 2] = -self.fy * p[..., 1] * w**2
        return J

    def triangulate(self, y: ArrayLike) -> Array:
        """Points in the left camera of image points: the inverse of :meth:`project`.

        Parameters
        ----------
        y : array_like, (..., 3)
            ``(u_left, u_right, v)``, pixels, with a disparity that is not zero.

        Returns
        -------
        ndarray, (..., 3)
            Metres.
        """
        y = np.asarray(y, dtype=float)
        p = np.empty_like(y)
        depth = self.fx_baseline / (y[..., 0] - y[..., 1])
        p[..., 0] = (y[..., 0] - self.cx) * depth / self.fx
        p[..., 1] = (y[..., 2] - self.cy) * depth / self.fy
        p[..., 2] = depth
        return p

    def triangulate_jacobian(self, y: ArrayLike) -> Array:
        """Derivative (..., 3, 3) of :meth:`triangulate` by the image point, metres per pixel."""
        y = np.asarray(y, dtype=float)
        p = self.triangulate(y)
        disparity = y[..., 0] - y[..., 1]
        J = np.zeros((*y.shape, 3))
        J[..., :, 0] = -p / disparity[..., None]
        J[..., :, 1] = p / disparity[..., None]
        J[..., 0, 0] += p[..., 2] / self.fx
        J[..., 1, 2] = p[..., 2] / self.fy
        return J

    def rays(self, y: Array) -> tuple[Array, Array]:
        """Rays (..., 3) of depth 1 and inverse depths (...), 1/m, of image points (..., 3)."""
        ray = np.ones_like(y)
        ray[..., 0] = (y[..., 0] - self.cx) / self.fx
        ray[..., 1] = (y[..., 2] - self.cy) / self.fy
        return ray, (y[..., 0] - y[..., 1]) / self.fx_baseline

    def median_flow(self, y: Array, motion: Array) -> float:
        """How far a motion (4, 4) of the body moves image points (n, 3), their median, pixels."""
        T_new_old = self.T_camera_body @ se3.inverse(motion) @ self.T_body_camera
        return float(np.median(np.linalg.norm(self.warp(y, T_new_old) - y, axis=1)))

    def warp(self, y: ArrayLike, T_new_old: ArrayLike) -> Array:
        """Image points after the left camera has moved: project after triangulate, in one.

        Written with inverse depth, so it is smooth through zero disparity (a point at infinity).

        Parameters
        ----------
        y : array_like, (..., 3)
            ``(u_left, u_right, v)`` in the old frame, pixels.
        T_new_old : array_like, (4, 4)
            Pose of the old left optical frame in the new one.

        Returns
        -------
        ndarray, (..., 3)
            ``(u_left, u_right, v)`` in the new frame, pixels.
        """
        T = np.asarray(T_new_old, dtype=float)
        ray, inverse_depth = self.rays(np.asarray(y, dtype=float))
        moved = ray @ T[:3, :3].T + inverse_depth[..., None] * T[:3, 3]
        warped = np.empty_like(moved)
        warped[..., 0] = self.fx * moved[..., 0] / moved[..., 2] + self.cx
        warped[..., 1] = warped[..., 0] - self.fx_baseline * inverse_depth / moved[..., 2]
        warped[..., 2] = self.fy * moved[..., 1] / moved[..., 2] + self.cy
        return warped
