# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From arrays to rclpy's messages, and back from those that only this package sends.

What the estimators take is decoded by :mod:`vislam_ros.data.bags.decoding`.

A pose covariance is, in the core, that of the error ``[rho; theta]`` on the right of the pose, in
body axes. In an Odometry message it stands about the axes of ``header.frame_id``, position
first: ``blkdiag(R, R) Sigma blkdiag(R, R)^T`` with ``R`` the pose's rotation. Numbers are copied,
never normalised or rounded, so a pose that went through a message is the same to the last bit.
"""

import array
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    Point,
    PoseStamped,
    Quaternion,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.feature_cloud import (
    FEATURE_FIELDS,
    NOISY_FEATURE_FIELDS,
    pack_features,
)
from vislam_ros.data.bags.layout import Frames
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

_COVARIANCE_TERMS = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")
_UPPER = np.triu_indices(3)

LANDMARK_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in "xyz"),
        ("id", "<u4"),
        *((name, "<f4") for name in _COVARIANCE_TERMS),
    ]
)
"""A point of ``slam/landmarks``: metres, square metres, 40 bytes."""

_FEATURE_POINT_FIELDS, _NOISY_POINT_FIELDS = (
    [
        PointField(name=name, offset=offset, datatype=datatype, count=1)
        for name, offset, datatype in fields
    ]
    for fields in (FEATURE_FIELDS, NOISY_FEATURE_FIELDS)
)
_LANDMARK_POINT_FIELDS = [
    PointField(
        name=name,
        offset=4 * place,
        datatype=PointField.UINT32 if name == "id" else PointField.FLOAT32,
        count=1,
    )
    for place, name in enumerate(LANDMARK_DTYPE.names or ())
]


def stamp_to_message(stamp: int) -> Time:
    """Stamp of nanoseconds."""
    seconds, nanoseconds = divmod(stamp, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def header(stamp: int, frame: str) -> Header:
    """Header of a stamp in nanoseconds and a frame."""
    return Header(stamp=stamp_to_message(stamp), frame_id=frame)


def covariance_to_ros(covariance: ArrayLike, R: ArrayLike) -> Array:
    """Pose covariance (6, 6) about the axes of the fixed frame, of one in body axes.

    ``blkdiag(R, R) Sigma blkdiag(R, R)^T`` with ``R`` (3, 3) from body to fixed frame.
    """
    R = np.asarray(R)
    blocks = np.asarray(covariance).reshape(2, 3, 2, 3).swapaxes(1, 2)
    return (R @ blocks @ R.T).swapaxes(1, 2).reshape(6, 6)


def covariance_from_ros(covariance: ArrayLike, R: ArrayLike) -> Array:
    """Inverse of :func:`covariance_to_ros`."""
    return covariance_to_ros(covariance, np.asarray(R).T)


def odometry(
    stamp: int,
    frame: str,
    child_frame: str,
    position: Sequence[float] | Array,
    quaternion: Sequence[float] | Array,
    covariance: Array,
    twist: Array | None = None,
    twist_covariance: Array | None = None,
) -> Odometry:
    """Odometry message of a pose.

    Parameters
    ----------
    stamp : int
        Nanoseconds.
    frame, child_frame : str
    position : (3,)
        Metres.
    quaternion : (4,)
        x, y, z, w.
    covariance : ndarray, (6, 6)
        Of the error ``[rho; theta]`` on the right, in body axes.
    twist : ndarray, (6,), optional
        ``[v; omega]`` in body axes.
    twist_covariance : ndarray, (6, 6), optional
    """
    message = Odometry(header=header(stamp, frame), child_frame_id=child_frame)
    pose = message.pose.pose
    pose.position = _point(position)
    pose.orientation = _quaternion(quaternion)
    R = se3.rotation_from_quaternion(quaternion)
    message.pose.covariance = covariance_to_ros(covariance, R).ravel()
    if twist is not None:
        message.twist.twist.linear = _vector(twist[:3])
        message.twist.twist.angular = _vector(twist[3:])
    if twist_covariance is not None:
        message.twist.covariance = np.ascontiguousarray(twist_covariance, dtype=float).ravel()
    return message


def covariance_from_odometry(message: Odometry) -> Array:
    """Pose covariance (6, 6) of the error ``[rho; theta]`` on the right, in body axes."""
    q = message.pose.pose.orientation
    R = se3.rotation_from_quaternion((q.x, q.y, q.z, q.w))
    return covariance_from_ros(np.reshape(message.pose.covariance, (6, 6)), R)


def pose_stamped(
    stamp: int, frame: str, position: Sequence[float] | Array, quaternion: Sequence[float] | Array
) -> PoseStamped:
    """PoseStamped of a position (3,) in metres and a quaternion (4,) x, y, z, w."""
    message = PoseStamped(header=header(stamp, frame))
    message.pose.position = _point(position)
    message.pose.orientation = _quaternion(quaternion)
    return message


def vector3_stamped(stamp: int, frame: str, vector: Sequence[float] | Array) -> Vector3Stamped:
    """Vector3Stamped of a vector (3,)."""
    return Vector3Stamped(header=header(stamp, frame), vector=_vector(vector))


def path(stamp: int, frame: str, poses: Iterable[PoseStamped]) -> PathMessage:
    """Path of poses."""
    return PathMessage(header=header(stamp, frame), poses=list(poses))


def transform(
    stamp: int,
    frame: str,
    child_frame: str,
    position: Sequence[float] | Array,
    quaternion: Sequence[float] | Array,
) -> TransformStamped:
    """TransformStamped of a position (3,) in metres and a quaternion (4,) x, y, z, w."""
    message = TransformStamped(header=header(stamp, frame), child_frame_id=child_frame)
    message.transform.translation = _vector(position)
    message.transform.rotation = _quaternion(quaternion)
    return message


def transform_of_odometry(message: Odometry) -> TransformStamped:
    """Transform that says the same as the pose of an Odometry message."""
    pose, result = message.pose.pose, TransformStamped(header=message.header)
    result.child_frame_id = message.child_frame_id
    result.transform.translation = Vector3(x=pose.position.x, y=pose.position.y, z=pose.position.z)
    result.transform.rotation = pose.orientation
    return result


def features_to_message(
    stamp: int,
    frame: str,
    ids: NDArray[np.uint32],
    pixels: NDArray[np.float32],
    noise: NDArray[np.float32] | None = None,
) -> PointCloud2:
    """Features cloud of ids (n,), pixels (n, 4) ``u_left, v_left, ...``, and their noise (n,)."""
    fields, size = (_FEATURE_POINT_FIELDS, 20) if noise is None else (_NOISY_POINT_FIELDS, 24)
    return _cloud(stamp, frame, fields, size, pack_features(ids, pixels, noise))


def image_to_message(stamp: int, frame: str, pixels: NDArray[np.uint8], encoding: str) -> Image:
    """Image of pixels (H, W) or (H, W, channels), and what they are called."""
    height, width = pixels.shape[:2]
    return Image(
        header=header(stamp, frame),
        height=height,
        width=width,
        encoding=encoding,
        step=pixels.nbytes // height,
        data=array.array("B", pixels.tobytes()),
    )


def calibration(
    stamp: int, frames: Frames, camera: StereoCamera, image_size: tuple[int, int]
) -> tuple[CameraInfo, CameraInfo, TransformStamped]:
    """Both camera infos of a rectified pair of an image size (width, height), and extrinsics."""
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    width, height = image_size
    infos = [
        CameraInfo(
            header=header(stamp, frames.camera),
            width=width,
            height=height,
            distortion_model="plumb_bob",
            d=np.zeros(5).tolist(),
            k=K.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([K, [shift, 0.0, 0.0]]).ravel(),
        )
        for shift in (0.0, -camera.fx_baseline)
    ]
    extrinsics = transform(
        stamp,
        frames.base,
        frames.camera,
        camera.position_body_camera,
        camera.quaternion_body_camera,
    )
    return infos[0], infos[1], extrinsics


def landmarks_to_message(stamp: int, frame: str, landmarks: LandmarkMap) -> PointCloud2:
    """Cloud of a landmark map, a :data:`LANDMARK_DTYPE` each."""
    points = np.empty(len(landmarks), dtype=LANDMARK_DTYPE)
    points["id"] = landmarks.ids
    for axis, name in enumerate("xyz"):
        points[name] = landmarks.positions[:, axis]
    for name, row, column in zip(_COVARIANCE_TERMS, *_UPPER, strict=True):
        points[name] = landmarks.covariances[:, row, column]
    return _cloud(
        stamp, frame, _LANDMARK_POINT_FIELDS, LANDMARK_DTYPE.itemsize, points.view(np.uint8)
    )


def landmarks_from_message(message: PointCloud2) -> LandmarkMap:
    """Landmark map of a cloud that :func:`landmarks_to_message` made.

    The points of one id stand in the order in which the id came to mean them, which gives back
    their generations.

    Raises
    ------
    RefusedMessage
        Where the data are no whole number of points.
    """
    if message.point_step != LANDMARK_DTYPE.itemsize or len(message.data) % message.point_step:
        raise RefusedMessage(
            Refusal.WRONG_SIZE, f"{len(message.data)} bytes are no whole number of landmarks"
        )
    points = np.frombuffer(message.data, dtype=LANDMARK_DTYPE)
    covariances = np.empty((len(points), 3, 3))
    for name, row, column in zip(_COVARIANCE_TERMS, *_UPPER, strict=True):
        covariances[:, row, column] = covariances[:, column, row] = points[name]
    return LandmarkMap(
        ids=points["id"].astype(np.uint32),
        generations=_occurrences(points["id"]),
        positions=np.stack([points[name] for name in "xyz"], axis=-1).astype(float),
        covariances=covariances,
    )


def status(name: str, values: Mapping[str, object]) -> DiagnosticStatus:
    """Diagnostic status of values, written so that numbers read back to the same float."""
    return DiagnosticStatus(
        name=name,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )


def status_array(
    stamp: Time, statuses: Sequence[DiagnosticStatus], frame: str = ""
) -> DiagnosticArray:
    """Diagnostic message of some statuses."""
    return DiagnosticArray(header=Header(stamp=stamp, frame_id=frame), status=list(statuses))


def status_values(message: DiagnosticArray, name: str) -> dict[str, str]:
    """Values of the status with a name.

    Raises
    ------
    RefusedMessage
        Where there is none.
    """
    for entry in message.status:
        if entry.name == name:
            return {value.key: value.value for value in entry.values}
    raise RefusedMessage(Refusal.BAD_FIELDS, f"no status {name!r} in this message")


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(float(value)) if isinstance(value, float) else str(value)


def _point(values: Sequence[float] | Array) -> Point:
    x, y, z = map(float, values)
    return Point(x=x, y=y, z=z)


def _vector(values: Sequence[float] | Array) -> Vector3:
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: Sequence[float] | Array) -> Quaternion:
    x, y, z, w = map(float, values)
    return Quaternion(x=x, y=y, z=z, w=w)


def _cloud(
    stamp: int, frame: str, fields: list[PointField], point_step: int, data: NDArray[np.uint8]
) -> PointCloud2:
    count = len(data) // point_step
    return PointCloud2(
        header=header(stamp, frame),
        height=1,
        width=count,
        fields=fields,
        is_bigendian=False,
        point_step=point_step,
        row_step=point_step * count,
        # Any other type of sequence is copied element by element, a thousand times slower.
        data=array.array("B", data.tobytes()),
        is_dense=True,
    )


def _occurrences(ids: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """How often each id stood earlier in the array, (n,)."""
    order = np.argsort(ids, kind="stable")
    _, first, counts = np.unique(ids[order], return_index=True, return_counts=True)
    result = np.empty(len(ids), dtype=np.uint32)
    result[order] = np.arange(len(ids)) - np.repeat(first, counts)
    return result
