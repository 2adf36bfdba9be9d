# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The small drive of imagery.folders as a bag, under the names of this package or of a driver."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from imagery.folders import (
    BASELINE,
    FOCAL,
    FRAMES,
    HEIGHT,
    SPEED,
    STAMPS,
    T_BODY_LEFT,
    WIDTH,
    Image,
    K,
    pair,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vislam_ros.core.geometry import se3
from vislam_ros.data.trajectory import NANOSECONDS

STORE = get_typestore(Stores.ROS2_JAZZY)
NEW: dict[str, Any] = {name.rsplit("/")[-1]: made for name, made in STORE.types.items()}

OURS = {
    "left": "/stereo/left/image_raw",
    "right": "/stereo/right/image_raw",
    "left_info": "/stereo/left/camera_info",
    "right_info": "/stereo/right/camera_info",
    "twist": "/imu/twist",
    "extrinsics": "/stereo/extrinsics",
}
#: As a RealSense's driver calls them.
REALSENSE = {
    "left": "/camera/infra1/image_rect_raw",
    "right": "/camera/infra2/image_rect_raw",
    "left_info": "/camera/infra1/camera_info",
    "right_info": "/camera/infra2/camera_info",
    "depth": "/camera/depth/image_rect_raw",
    "gyro": "/camera/gyro/sample",
    "accel": "/camera/accel/sample",
    "tf": "/tf_static",
}

Message = tuple[str, str, int, Any]
Change = Callable[[str, int, Any], Any]


def header(stamp: int, frame: str) -> Any:
    sec, nanosec = divmod(int(stamp), NANOSECONDS)
    return NEW["Header"](stamp=NEW["Time"](sec=sec, nanosec=nanosec), frame_id=frame)


def vector(values: Iterable[float]) -> Any:
    x, y, z = (float(value) for value in values)
    return NEW["Vector3"](x=x, y=y, z=z)


def transform(stamp: int, parent: str, child: str, T: Any) -> Any:
    x, y, z, w = se3.quaternion_from_rotation(T[:3, :3]).tolist()
    return NEW["TransformStamped"](
        header=header(stamp, parent),
        child_frame_id=child,
        transform=NEW["Transform"](
            translation=vector(T[:3, 3]), rotation=NEW["Quaternion"](x=x, y=y, z=z, w=w)
        ),
    )


def image_message(stamp: int, frame: str, image: Image, encoding: str = "mono8") -> Any:
    rows = image.reshape(image.shape[0], -1)
    return NEW["Image"](
        header=header(stamp, frame),
        height=image.shape[0],
        width=image.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1] * image.itemsize,
        data=rows.reshape(-1).view(np.uint8),
    )


def compressed_message(stamp: int, frame: str, image: Image) -> Any:
    _, data = cv2.imencode(".png", image)
    return NEW["CompressedImage"](header=header(stamp, frame), format="png", data=data.ravel())


def camera_info(frame: str, shift: float, R: Any = None, D: Any = None) -> Any:
    return NEW["CameraInfo"](
        header=header(int(STAMPS[0]), frame),
        height=HEIGHT,
        width=WIDTH,
        distortion_model="plumb_bob",
        d=np.zeros(5) if D is None else D,
        k=K.ravel(),
        r=(np.eye(3) if R is None else R).ravel(),
        p=np.column_stack([K, [shift, 0.0, 0.0]]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=NEW["RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def imu_message(stamp: int, frame: str, omega: Iterable[float]) -> Any:
    return NEW["Imu"](
        header=header(stamp, frame),
        orientation=NEW["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.array([-1.0, *[0.0] * 8]),
        angular_velocity=vector(omega),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector((0.0, 0.0, 9.81)),
        linear_acceleration_covariance=np.zeros(9),
    )


def twist_message(stamp: int, frame: str) -> Any:
    twist = NEW["Twist"](linear=vector((0.0, -SPEED, 0.0)), angular=vector((0.0, 0.0, 0.0)))
    return NEW["TwistWithCovarianceStamped"](
        header=header(stamp, frame),
        twist=NEW["TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
    )


def drive_messages(
    names: Mapping[str, str], *, frame: str = "camera_left_optical", compressed: bool = False
) -> list[Message]:
    """Messages of the drive on the topics that are named: role to name."""
    first = int(STAMPS[0])
    kind = "sensor_msgs/msg/CompressedImage" if compressed else "sensor_msgs/msg/Image"
    build = compressed_message if compressed else image_message
    found: list[Message] = []

    def add(role: str, msgtype: str, stamp: int, message: Any) -> None:
        if role in names:
            found.append((names[role], msgtype, stamp, message))

    info = "sensor_msgs/msg/CameraInfo"
    add("left_info", info, first, camera_info(frame, 0.0))
    add("right_info", info, first, camera_info(frame, -FOCAL * BASELINE))
    mount = transform(first, "base_link", "camera_left_optical", T_BODY_LEFT)
    add("extrinsics", "geometry_msgs/msg/TransformStamped", first, mount)
    chain = [
        transform(first, "mount", "imu_frame", np.eye(4)),
        transform(first, "mount", frame, T_BODY_LEFT),
    ]
    add("tf", "tf2_msgs/msg/TFMessage", first, NEW["TFMessage"](transforms=chain))
    for k, stamp in enumerate(STAMPS.tolist()):
        left, right = pair(k)
        imu = imu_message(stamp, "imu_frame", (0.001, -0.002, 0.003))
        for role in ("gyro", "accel", "imu"):
            add(role, "sensor_msgs/msg/Imu", stamp, imu)
        twist = "geometry_msgs/msg/TwistWithCovarianceStamped"
        add("twist", twist, stamp, twist_message(stamp, "base_link"))
        add("left", kind, stamp, build(stamp, frame, left))
        add("right", kind, stamp, build(stamp, frame, right))
        add("depth", kind, stamp, build(stamp, frame, left))
    assert len(found) >= 2 * FRAMES
    return found


def write_messages(path: Path, messages: Iterable[Message]) -> Path:
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, msgtype, stamp, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=STORE)
            data = STORE.serialize_cdr(message, msgtype)
            writer.write(connections[topic], stamp, data)
    return path
