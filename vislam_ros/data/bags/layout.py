# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a bag holds: topics, message types, quality of service and frames, in one place."""

from dataclasses import dataclass

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

# What rosbag2 itself records where a topic has no deadline, lifespan or lease.
_UNLIMITED = QosTime(9223372036, 854775807)

STREAM_QOS = Qos(
    history=QosHistory.KEEP_ALL,
    depth=0,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.VOLATILE,
    deadline=_UNLIMITED,
    lifespan=_UNLIMITED,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_UNLIMITED,
    avoid_ros_namespace_conventions=False,
)
"""Every message matters: KEEP_LAST loses some where a bag is played fast."""

LATCHED_QOS = STREAM_QOS._replace(
    history=QosHistory.KEEP_LAST, depth=1, durability=QosDurability.TRANSIENT_LOCAL
)
"""Sent once, kept for those who come later."""


@dataclass(frozen=True)
class Topic:
    """A topic of the graph's inputs.

    Attributes
    ----------
    name : str
        Relative, as the nodes use it.
    msgtype : str
        As rosbags writes it, ``package/msg/Type``.
    qos : rosbags.interfaces.Qos
    """

    name: str
    msgtype: str
    qos: Qos

    @property
    def recorded(self) -> str:
        """Absolute name without namespace, as it stands in a bag."""
        return f"/{self.name}"

    @property
    def latched(self) -> bool:
        """Whether late subscribers are to get the last message."""
        return self.qos.durability is QosDurability.TRANSIENT_LOCAL


IMU = Topic("imu/data", "sensor_msgs/msg/Imu", STREAM_QOS)
TWIST = Topic("imu/twist", "geometry_msgs/msg/TwistWithCovarianceStamped", STREAM_QOS)
FEATURES = Topic("stereo/features", "sensor_msgs/msg/PointCloud2", STREAM_QOS)
LEFT_CAMERA = Topic("stereo/left/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED_QOS)
RIGHT_CAMERA = Topic("stereo/right/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED_QOS)
EXTRINSICS = Topic("stereo/extrinsics", "geometry_msgs/msg/TransformStamped", LATCHED_QOS)
STATIC_TRANSFORMS = Topic("tf_static", "tf2_msgs/msg/TFMessage", LATCHED_QOS)
GROUND_TRUTH = Topic("ground_truth/odometry", "nav_msgs/msg/Odometry", STREAM_QOS)

TOPICS = (
    LEFT_CAMERA,
    RIGHT_CAMERA,
    EXTRINSICS,
    STATIC_TRANSFORMS,
    IMU,
    TWIST,
    GROUND_TRUTH,
    FEATURES,
)
"""In the order in which messages of one stamp are written: what predicts before what corrects."""


PROVENANCE = "provenance.json"
"""File in a bag directory that says where the bag comes from."""

CHECKSUMS = "SHA256SUMS"
"""File in a bag directory with the SHA-256 of each other file, as ``sha256sum -c`` reads it."""


@dataclass(frozen=True)
class Frames:
    """Frame ids of the messages in a bag.

    Both cameras' messages carry the left one's optical frame: the right projection matrix is
    relative to it.
    """

    map: str = "map"
    body: str = "base_link"
    camera: str = "camera_left_optical"
