# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a drive to its messages, in the order in which a bag holds them."""

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from vislam_ros.data.bags.feature_cloud import (
    FEATURE_DTYPE,
    FEATURE_FIELDS,
    NOISY_FEATURE_DTYPE,
    NOISY_FEATURE_FIELDS,
    pack_features,
)
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    FEATURES,
    GROUND_TRUTH,
    IMU,
    LEFT_CAMERA,
    RIGHT_CAMERA,
    STATIC_TRANSFORMS,
    TWIST,
    Frames,
    Topic,
)
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

Stream: TypeAlias = tuple[Topic, NDArray[np.int64], Callable[[int], Any]]
"""A topic, its increasing stamps (n,), and what makes its k-th message."""

_LATEST = 2**31 * NANOSECONDS
_UNKNOWN = np.zeros(9)
_ABSENT = np.array([-1.0, *[0.0] * 8])
_UNKNOWN_6 = np.zeros(36)


@functools.cache
def jazzy_types() -> Typestore:
    """Return the message types of ROS 2 Jazzy; one store for all, as each compiles its code."""
    return get_typestore(Stores.ROS2_JAZZY)


def without_padding(data: bytes, msgtype: str) -> bytes:
    """CDR of a message, with zeros between its fields, where who serialised it leaves anything."""
    store = jazzy_types()
    return bytes(store.serialize_cdr(store.deserialize_cdr(data, msgtype), msgtype))


def encode_drive(
    drive: Drive, frames: Frames, store: Typestore
) -> Iterator[tuple[Topic, int, memoryview]]:
    """Yield topic, stamp (ns) and CDR bytes of each message.

    Latched messages carry the first stamp and come before all others; those of one stamp come
    in the order of :data:`vislam_ros.data.bags.layout.TOPICS`.

    Raises
    ------
    VislamError
        Where the drive is empty or a stamp does not fit into a message.
    """
    messages = DriveMessages(drive, frames, store)
    streams = messages.streams()
    streams.append((FEATURES, drive.feature_stamps, messages.features))
    yield from in_order(drive.name, messages.latched, streams, store)


def in_order(
    name: str,
    latched: Callable[[int], Sequence[tuple[Topic, Any]]],
    streams: Sequence[Stream],
    store: Typestore,
) -> Iterator[tuple[Topic, int, memoryview]]:
    """Yield latched messages and then those of streams, see :func:`encode_drive`.

    Parameters
    ----------
    name : str
        What to call the drive in an error.
    latched : callable
        Makes latched messages of a stamp (ns).
    streams : sequence of (Topic, ndarray, callable)
        Topic, increasing stamps (n,), and what makes the k-th message; asked in their order.
    store : Typestore
    """
    stamps = np.concatenate([stamps for _, stamps, _ in streams])
    if not len(stamps):
        raise VislamError(f"{name}: holds no measurement: there is nothing to write")
    first = int(stamps.min())
    if first < 0 or stamps.max() >= _LATEST:
        raise VislamError(
            f"{name}: stamps from {first} to {stamps.max()} ns: messages hold those from "
            "1970 to 2038"
        )
    for topic, message in latched(first):
        yield topic, first, store.serialize_cdr(message, topic.msgtype)
    which = np.repeat(np.arange(len(streams)), [len(stamps) for _, stamps, _ in streams])
    index = np.concatenate([np.arange(len(stamps)) for _, stamps, _ in streams])
    for place in np.lexsort((which, stamps)):
        topic, _, build = streams[which[place]]
        data = store.serialize_cdr(build(int(index[place])), topic.msgtype)
        yield topic, int(stamps[place]), data


class DriveMessages:
    """Builds the messages of a drive."""

    def __init__(self, drive: Drive, frames: Frames, store: Typestore):
        self._drive = drive
        self._frames = frames
        # Constructors by short name: the long names differ in their package only.
        self._new: dict[str, Any] = {name.rsplit("/")[-1]: c for name, c in store.types.items()}
        self._none = self._vector([0.0, 0.0, 0.0])
        self._fields = [
            self._new["PointField"](name=name, offset=offset, datatype=datatype, count=1)
            for name, offset, datatype in (
                FEATURE_FIELDS if drive.noise is None else NOISY_FEATURE_FIELDS
            )
        ]
        self._point_step = (FEATURE_DTYPE if drive.noise is None else NOISY_FEATURE_DTYPE).itemsize

    def streams(self) -> list[Stream]:
        """What a drive holds beside its features."""
        drive = self._drive
        streams: list[Stream] = [(IMU, drive.twist_stamps, self.imu)]
        if drive.measures_velocity:
            streams.append((TWIST, drive.twist_stamps, self.twist))
        if drive.ground_truth is not None:
            truth = drive.ground_truth
            streams.append((GROUND_TRUTH, truth.stamps, lambda k: self.odometry(truth, k)))
        return streams

    def latched(self, stamp: int) -> list[tuple[Topic, Any]]:
        """Calibration, once as users of cameras and once as users of TF expect it."""
        camera = self._drive.camera
        return [
            (LEFT_CAMERA, self._rectified_info(stamp, 0.0)),
            (RIGHT_CAMERA, self._rectified_info(stamp, -camera.fx_baseline)),
            *self.extrinsics(stamp, camera.position_body_camera, camera.quaternion_body_camera),
        ]

    def extrinsics(
        self, stamp: int, position: Iterable[float], quaternion: Iterable[float]
    ) -> list[tuple[Topic, Any]]:
        """Left camera in the body, position (3,) and quaternion (4,), on both of its topics."""
        extrinsics = self._new["TransformStamped"](
            header=self._header(stamp, self._frames.base),
            child_frame_id=self._frames.camera,
            transform=self._new["Transform"](
                translation=self._vector(position), rotation=self._quaternion(quaternion)
            ),
        )
        return [
            (EXTRINSICS, extrinsics),
            (STATIC_TRANSFORMS, self._new["TFMessage"](transforms=[extrinsics])),
        ]

    def imu(self, k: int) -> Any:
        """Angular velocity of a twist, and the force where it was measured."""
        forces = self._drive.accelerations
        force = self._none if forces is None else self._vector(forces[k])
        measured = forces is not None and not np.isnan(forces[k]).any()
        return self._new["Imu"](
            header=self._header(self._drive.twist_stamps[k], self._frames.base),
            orientation=self._quaternion((0.0, 0.0, 0.0, 1.0)),
            orientation_covariance=_ABSENT,
            angular_velocity=self._vector(self._drive.twists[k, 3:]),
            angular_velocity_covariance=_UNKNOWN,
            linear_acceleration=force if measured else self._none,
            linear_acceleration_covariance=_UNKNOWN if measured else _ABSENT,
        )

    def twist(self, k: int) -> Any:
        """Twist with velocity and angular velocity."""
        return self._new["TwistWithCovarianceStamped"](
            header=self._header(self._drive.twist_stamps[k], self._frames.base),
            twist=self._twist(self._drive.twists[k, :3], self._drive.twists[k, 3:]),
        )

    def features(self, k: int) -> Any:
        """Features of a frame."""
        ids, pixels = self._drive.frame(k)
        return self._new["PointCloud2"](
            header=self._header(self._drive.feature_stamps[k], self._frames.camera),
            height=1,
            width=len(ids),
            fields=self._fields,
            is_bigendian=False,
            point_step=self._point_step,
            row_step=self._point_step * len(ids),
            data=pack_features(ids, pixels, self._drive.noise_of(k)),
            is_dense=True,
        )

    def odometry(self, trajectory: Trajectory, k: int) -> Any:
        """Pose of a trajectory."""
        x, y, z = (float(value) for value in trajectory.positions[k])
        return self._new["Odometry"](
            header=self._header(trajectory.stamps[k], self._frames.map),
            child_frame_id=self._frames.base,
            pose=self._new["PoseWithCovariance"](
                pose=self._new["Pose"](
                    position=self._new["Point"](x=x, y=y, z=z),
                    orientation=self._quaternion(trajectory.quaternions[k]),
                ),
                covariance=_UNKNOWN_6,
            ),
            twist=self._twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        )

    def _rectified_info(self, stamp: int, right_shift: float) -> Any:
        camera = self._drive.camera
        K = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], dtype=float)
        P = np.insert(K.reshape(3, 3), 3, [right_shift, 0.0, 0.0], axis=1)
        width, height = self._drive.image_size
        return self.camera_info(
            stamp,
            height=height,
            width=width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K,
            r=np.eye(3).ravel(),
            p=P.ravel(),
        )

    def camera_info(self, stamp: int, **fields: Any) -> Any:
        """CameraInfo of the fields that say what the camera is."""
        return self._new["CameraInfo"](
            header=self._header(stamp, self._frames.camera),
            binning_x=0,
            binning_y=0,
            roi=self._new["RegionOfInterest"](
                x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
            ),
            **fields,
        )

    def image(self, stamp: int, pixels: NDArray[Any], encoding: str) -> Any:
        """Image of pixels (H, W) or (H, W, channels) of 8 or 16 bits."""
        rows = np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1)
        rows = rows.astype(rows.dtype.newbyteorder("<"), copy=False)
        return self._new["Image"](
            header=self._header(stamp, self._frames.camera),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1] * rows.itemsize,
            data=rows.view(np.uint8).ravel(),
        )

    def _header(self, stamp: int, frame: str) -> Any:
        sec, nanosec = divmod(int(stamp), NANOSECONDS)
        return self._new["Header"](
            stamp=self._new["Time"](sec=sec, nanosec=nanosec), frame_id=frame
        )

    def _twist(self, linear: Iterable[float], angular: Iterable[float]) -> Any:
        return self._new["TwistWithCovariance"](
            twist=self._new["Twist"](linear=self._vector(linear), angular=self._vector(angular)),
            covariance=_UNKNOWN_6,
        )

    def _vector(self, values: Iterable[float]) -> Any:
        x, y, z = values
        return self._new["Vector3"](x=float(x), y=float(y), z=float(z))

    def _quaternion(self, values: Iterable[float]) -> Any:
        x, y, z, w = values
        return self._new["Quaternion"](x=float(x), y=float(y), z=float(z), w=float(w))
