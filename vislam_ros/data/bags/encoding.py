# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a drive to its messages, in the order in which a bag holds them."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
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

_LATEST = 2**31 * NANOSECONDS
_UNKNOWN = np.zeros(9)
_ABSENT = np.array([-1.0, *[0.0] * 8])
_UNKNOWN_6 = np.zeros(36)


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
    messages = _Messages(drive, frames, store)
    streams: list[tuple[Topic, NDArray[np.int64], Callable[[int], Any]]] = [
        (IMU, drive.twist_stamps, messages.imu)
    ]
    if drive.measures_velocity:
        streams.append((TWIST, drive.twist_stamps, messages.twist))
    if drive.ground_truth is not None:
        truth = drive.ground_truth
        streams.append((GROUND_TRUTH, truth.stamps, lambda k: messages.odometry(truth, k)))
    streams.append((FEATURES, drive.feature_stamps, messages.features))

    stamps = np.concatenate([stamps for _, stamps, _ in streams])
    if not len(stamps):
        raise VislamError(f"{drive.name}: holds no measurement: there is nothing to write")
    first = int(stamps.min())
    if first < 0 or stamps.max() >= _LATEST:
        raise VislamError(
            f"{drive.name}: stamps from {first} to {stamps.max()} ns: messages hold those from "
            "1970 to 2038"
        )
    for topic, message in messages.latched(first):
        yield topic, first, store.serialize_cdr(message, topic.msgtype)
    which = np.repeat(np.arange(len(streams)), [len(stamps) for _, stamps, _ in streams])
    index = np.concatenate([np.arange(len(stamps)) for _, stamps, _ in streams])
    for place in np.lexsort((which, stamps)):
        topic, _, build = streams[which[place]]
        data = store.serialize_cdr(build(int(index[place])), topic.msgtype)
        yield topic, int(stamps[place]), data


class _Messages:
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

    def latched(self, stamp: int) -> list[tuple[Topic, Any]]:
        """Calibration, once as users of cameras and once as users of TF expect it."""
        camera = self._drive.camera
        extrinsics = self._new["TransformStamped"](
            header=self._header(stamp, self._frames.base),
            child_frame_id=self._frames.camera,
            transform=self._new["Transform"](
                translation=self._vector(camera.position_body_camera),
                rotation=self._quaternion(camera.quaternion_body_camera),
            ),
        )
        return [
            (LEFT_CAMERA, self._camera_info(stamp, 0.0)),
            (RIGHT_CAMERA, self._camera_info(stamp, -camera.fx_baseline)),
            (EXTRINSICS, extrinsics),
            (STATIC_TRANSFORMS, self._new["TFMessage"](transforms=[extrinsics])),
        ]

    def imu(self, k: int) -> Any:
        return self._new["Imu"](
            header=self._header(self._drive.twist_stamps[k], self._frames.base),
            orientation=self._quaternion((0.0, 0.0, 0.0, 1.0)),
            orientation_covariance=_ABSENT,
            angular_velocity=self._vector(self._drive.twists[k, 3:]),
            angular_velocity_covariance=_UNKNOWN,
            linear_acceleration=self._none,
            linear_acceleration_covariance=_ABSENT,
        )

    def twist(self, k: int) -> Any:
        return self._new["TwistWithCovarianceStamped"](
            header=self._header(self._drive.twist_stamps[k], self._frames.base),
            twist=self._twist(self._drive.twists[k, :3], self._drive.twists[k, 3:]),
        )

    def features(self, k: int) -> Any:
        ids, pixels = self._drive.frame(k)
        noise = self._drive.noise
        if noise is not None:
            noise = noise[self._drive.offsets[k] : self._drive.offsets[k + 1]]
        return self._new["PointCloud2"](
            header=self._header(self._drive.feature_stamps[k], self._frames.camera),
            height=1,
            width=len(ids),
            fields=self._fields,
            is_bigendian=False,
            point_step=self._point_step,
            row_step=self._point_step * len(ids),
            data=pack_features(ids, pixels, noise),
            is_dense=True,
        )

    def odometry(self, trajectory: Trajectory, k: int) -> Any:
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

    def _camera_info(self, stamp: int, right_shift: float) -> Any:
        camera = self._drive.camera
        K = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], dtype=float)
        P = np.insert(K.reshape(3, 3), 3, [right_shift, 0.0, 0.0], axis=1)
        width, height = self._drive.image_size
        return self._new["CameraInfo"](
            header=self._header(stamp, self._frames.camera),
            height=height,
            width=width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K,
            r=np.eye(3).ravel(),
            p=P.ravel(),
            binning_x=0,
            binning_y=0,
            roi=self._new["RegionOfInterest"](
                x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
            ),
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
