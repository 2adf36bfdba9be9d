# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From messages to arrays; a message that is bad by itself raises ValueError with the reason."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.bags.feature_cloud import unpack_features
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Projection:
    """What a CameraInfo says of a rectified camera.

    Attributes
    ----------
    P : ndarray, (3, 4)
        Projection matrix relative to the left camera, pixels.
    image_size : tuple of int, (2,)
        Width and height, pixels.
    """

    P: Array
    image_size: tuple[int, int]


def stamp(header: Any) -> int:
    """Nanoseconds of a header's stamp."""
    if header.stamp.sec < 0:
        raise ValueError("stamp before 1970")
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def twist(message: Any) -> Array:
    """``[v; omega]`` (6,) of a TwistWithCovarianceStamped, metres and radians a second."""
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    return _finite([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])


def features(message: Any) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Ids (n,), increasing, and pixels (n, 4) of a features PointCloud2.

    Raises
    ------
    VislamError
        Where a field is missing or cannot be used.
    """
    ids, pixels = unpack_features(message)
    if not np.all(np.isfinite(pixels)):
        raise ValueError("not finite")
    if np.all(ids[1:] > ids[:-1]):
        return ids, pixels
    order = np.argsort(ids, kind="stable")
    ids, pixels = ids[order], pixels[order]
    if np.any(ids[1:] == ids[:-1]):
        raise ValueError("an id appears twice")
    return ids, pixels


def pose(message: Any) -> Array:
    """Position in metres and quaternion x, y, z, w (7,) of an Odometry."""
    return _pose(message.pose.pose.position, message.pose.pose.orientation)


def transform(message: Any) -> Array:
    """Position in metres and quaternion x, y, z, w (7,) of a TransformStamped."""
    return _pose(message.transform.translation, message.transform.rotation)


def projection(message: Any) -> Projection:
    """Projection of a CameraInfo."""
    P = _finite(message.p).reshape(3, 4)
    if P[0, 0] <= 0 or P[1, 1] <= 0:
        raise ValueError("field p has no positive focal length")
    return Projection(P, (int(message.width), int(message.height)))


def stereo_camera(left: Projection, right: Projection, extrinsics: Array) -> StereoCamera:
    """Camera of both projections and of the left camera's pose (7,) in the body.

    Raises
    ------
    ValueError
        Where the two are not a rectified pair with the right camera to the right.
    """
    if np.max(np.abs(left.P[:, :3] - right.P[:, :3])) > 1e-3:
        raise ValueError(
            "field p differs in focal length or principal point: rectify both to the same"
        )
    fx_baseline = -float(right.P[0, 3])
    if fx_baseline <= 0:
        raise ValueError(
            f"field p[3] of the right camera is {right.P[0, 3]}: it must be -fx times the baseline"
        )
    x, y, z, qx, qy, qz, qw = (float(value) for value in extrinsics)
    return StereoCamera(
        fx=float(left.P[0, 0]),
        fy=float(left.P[1, 1]),
        cx=float(left.P[0, 2]),
        cy=float(left.P[1, 2]),
        fx_baseline=fx_baseline,
        position_body_camera=(x, y, z),
        quaternion_body_camera=(qx, qy, qz, qw),
    )


def _finite(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    if not np.all(np.isfinite(array)):
        raise ValueError("not finite")
    return array


def _pose(position: Any, orientation: Any) -> Array:
    q = orientation
    values = _finite([position.x, position.y, position.z, q.x, q.y, q.z, q.w])
    if abs(np.linalg.norm(values[3:]) - 1.0) > 1e-3:
        raise ValueError("not a unit quaternion")
    return values
