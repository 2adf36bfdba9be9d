# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From messages to what the core takes, for the message classes of rclpy and of rosbags alike.

Only attributes are used, so the nodes and the reader of bags decode with the same functions and
refuse the same messages: each raises a RefusedMessage that says what is wrong.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import (
    Intrinsics,
    NoStereoPairError,
    PixelRectification,
    RectifiedPair,
    rectified_pair,
)
from vislam_ros.core.motion import UNKNOWN_VELOCITY_VARIANCE
from vislam_ros.core.ranges import (
    BASELINE,
    FOCAL_LENGTH,
    MOUNT,
    PRINCIPAL_POINT,
    SPECIFIC_FORCE,
    TURN_RATE,
)
from vislam_ros.core.tracking.refusals import (
    Refusal,
    RefusedMessage,
    check_features,
    check_pose,
    check_range,
    check_twist,
)
from vislam_ros.data.bags.feature_cloud import unpack_features
from vislam_ros.data.bags.layout import Frames
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


def stamp_of(header: Any) -> int:
    """Nanoseconds of a header's stamp."""
    if header.stamp.nanosec >= NANOSECONDS:
        raise RefusedMessage(
            Refusal.BAD_FIELDS,
            f"header.stamp.nanosec is {header.stamp.nanosec}: a second has {NANOSECONDS}",
        )
    stamp = int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)
    if stamp < 0:
        raise RefusedMessage(Refusal.BEFORE_1970, f"header.stamp.sec is {header.stamp.sec}")
    return stamp


def stamp_if_known(message: Any) -> int | None:
    """Nanoseconds of a message's stamp, None where it has none that can be."""
    try:
        return stamp_of(message.header)
    except (AttributeError, RefusedMessage):
        return None


def twist(message: Any, frames: Frames) -> tuple[int, Array]:
    """Stamp (ns) and ``[v; omega]`` (6,) of a TwistWithCovarianceStamped, metres and radians."""
    _check_frame("header.frame_id", message.header.frame_id, "base_frame", frames.base)
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    values = np.array([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])
    check_twist(values)
    return stamp_of(message.header), values


def angular_velocity(message: Any, frames: Frames) -> tuple[int, Array]:
    """Stamp (ns) and angular velocity (3,) of an Imu, radians a second."""
    _check_frame("header.frame_id", message.header.frame_id, "base_frame", frames.base)
    if message.angular_velocity_covariance[0] == -1.0:
        raise RefusedMessage(Refusal.ABSENT_FIELD, "it says that it has no angular velocity")
    omega = _finite(
        [message.angular_velocity.x, message.angular_velocity.y, message.angular_velocity.z]
    )
    check_range(TURN_RATE, omega)
    return stamp_of(message.header), omega


def linear_acceleration(message: Any) -> Array | None:
    """Specific force (3,) of an Imu, m/s^2; None where it has none, or none that can be."""
    if message.linear_acceleration_covariance[0] == -1.0:
        return None
    a = message.linear_acceleration
    force = np.array([a.x, a.y, a.z])
    return None if SPECIFIC_FORCE.complaint(force) else force


def features(
    message: Any, frames: Frames
) -> tuple[int, NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32] | None]:
    """Stamp (ns), increasing ids (n,), pixels (n, 4) and noise (n,) of a features PointCloud2.

    Pixels are ``u_left, v_left, u_right, v_right``; the noise is None where none is stated.
    """
    _check_frame("header.frame_id", message.header.frame_id, "camera_frame", frames.camera)
    ids, pixels, noise = unpack_features(message)
    check_features(ids, pixels, noise)
    if not np.all(ids[1:] > ids[:-1]):
        order = np.argsort(ids)
        ids, pixels = ids[order], pixels[order]
        noise = None if noise is None else noise[order]
    return stamp_of(message.header), ids, pixels, noise


def prediction(message: Any, frames: Frames) -> tuple[int, Array, Array, bool]:
    """Stamp (ns), position (3,) and unit quaternion (4,) of a predicted pose; see :func:`pose`.

    With them comes whether its velocity is known: one that is marked absent, or told with a
    variance that says nothing, is not.
    """
    _check_frame("header.frame_id", message.header.frame_id, "odom_frame", frames.odom)
    _check_frame("child_frame_id", message.child_frame_id, "base_frame", frames.base)
    velocity_known = 0.0 <= message.twist.covariance[0] < UNKNOWN_VELOCITY_VARIANCE
    return *true_pose(message), bool(velocity_known)


def true_pose(message: Any) -> tuple[int, Array, Array]:
    """Stamp (ns), position (3,) and unit quaternion (4,) of the ground truth; see :func:`pose`."""
    stamp, position, quaternion = pose(message)
    check_pose(position, quaternion)
    return stamp, position, quaternion


def pose(message: Any) -> tuple[int, Array, Array]:
    """Stamp (ns), position (3,) in metres and quaternion (4,) x, y, z, w of any Odometry.

    Whatever numbers it holds: a recorder writes down a wrong estimate, too.
    """
    position, quaternion = message.pose.pose.position, message.pose.pose.orientation
    return stamp_of(message.header), *_values_of(position, quaternion)


def transform(message: Any) -> tuple[int, Array, Array, str, str]:
    """Stamp (ns), position, quaternion, parent and child of a transform, as they stand there."""
    position, quaternion = _values_of(message.transform.translation, message.transform.rotation)
    frames = message.header.frame_id, message.child_frame_id
    return (stamp_of(message.header), position, quaternion, *frames)


def extrinsics(message: Any, frames: Frames) -> tuple[Array, Array]:
    """Left camera in the body: position (3,) and quaternion (4,) of a TransformStamped."""
    _check_frame("header.frame_id", message.header.frame_id, "base_frame", frames.base)
    _check_frame("child_frame_id", message.child_frame_id, "camera_frame", frames.camera)
    position, quaternion = _values_of(message.transform.translation, message.transform.rotation)
    check_pose(position, quaternion)
    check_range(MOUNT, position)
    return position, quaternion


def projection(message: Any) -> Projection:
    """Projection of a CameraInfo."""
    P = _finite(message.p).reshape(3, 4)
    if P[0, 0] <= 0 or P[1, 1] <= 0:
        raise RefusedMessage(
            Refusal.NOT_A_PAIR, "field p has no positive focal length: calibrate the camera"
        )
    check_range(FOCAL_LENGTH, [P[0, 0], P[1, 1]])
    check_range(PRINCIPAL_POINT, P[:2, 2])
    return Projection(P, (int(message.width), int(message.height)))


def pair(left: Projection, right: Projection) -> RectifiedPair:
    """Rectify what two camera infos say: the right one may have other intrinsics than the left.

    Raises
    ------
    RefusedMessage
        Where they are no stereo pair with the right camera to the right.
    """
    if right.P[0, 3] >= 0:
        raise RefusedMessage(
            Refusal.NOT_A_PAIR,
            f"field p[3] of the right camera is {right.P[0, 3]}: it must be -fx times the "
            "baseline",
        )
    # P = K [I | -c] of a camera at c.
    T_left_right = np.eye(4)
    T_left_right[:2, 3] = -right.P[:2, 3] / right.P.diagonal()[:2]
    try:
        rectified = rectified_pair(
            Intrinsics.of_matrix(left.P), Intrinsics.of_matrix(right.P), T_left_right
        )
    except NoStereoPairError as error:
        raise RefusedMessage(
            Refusal.NOT_A_PAIR, f"field p: {error}: calibrate both as one pair"
        ) from None
    check_range(BASELINE, rectified.baseline)
    return rectified


def stereo_camera(
    left: Projection, right: Projection, position: Array, quaternion: Array
) -> tuple[StereoCamera, PixelRectification | None]:
    """Camera of two camera infos and of the left camera's pose in the body.

    Returns
    -------
    camera : StereoCamera
    rectification : PixelRectification or None
        What the pixels of its features have to go through.

    Raises
    ------
    RefusedMessage
        See :func:`pair`.
    """
    rectified = pair(left, right)
    # Without rounding where the right camera is as the left.
    fx_baseline = -float(right.P[0, 3]) * float(left.P[0, 0] / right.P[0, 0])
    if rectified.R_left_rectified is not None:
        fx_baseline = float(left.P[0, 0]) * rectified.baseline
        R_body_left = se3.rotation_from_quaternion(quaternion)
        quaternion = se3.quaternion_from_rotation(R_body_left @ rectified.R_left_rectified)
    x, y, z = position.tolist()
    qx, qy, qz, qw = quaternion.tolist()
    camera = StereoCamera(
        fx=float(left.P[0, 0]),
        fy=float(left.P[1, 1]),
        cx=float(left.P[0, 2]),
        cy=float(left.P[1, 2]),
        fx_baseline=fx_baseline,
        position_body_camera=(x, y, z),
        quaternion_body_camera=(qx, qy, qz, qw),
    )
    return camera, rectified.pixels


def _check_frame(field: str, frame: str, parameter: str, expected: str) -> None:
    if frame != expected:
        raise RefusedMessage(
            Refusal.UNKNOWN_FRAME,
            f"{field} is {frame!r}, not {expected!r}: set the parameter {parameter} to it",
        )


def _finite(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    if not np.all(np.isfinite(array)):
        raise RefusedMessage(Refusal.NON_FINITE)
    return array


def _values_of(translation: Any, rotation: Any) -> tuple[Array, Array]:
    position = np.array([translation.x, translation.y, translation.z])
    return position, np.array([rotation.x, rotation.y, rotation.z, rotation.w])
