# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph and its bags, their types and quality of service, and frames: once."""

from dataclasses import dataclass, replace

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from vislam_ros.core.tracking.refusals import Stream

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

NEWEST_QOS = STREAM_QOS._replace(history=QosHistory.KEEP_LAST, depth=1)
"""For somebody who looks: one who is slow is to hold nobody up."""


VIEW_QOS = STREAM_QOS._replace(history=QosHistory.KEEP_LAST, depth=100)
"""Of transforms, as tf2 itself has it: a viewer that is slow must not hold up the nodes."""


@dataclass(frozen=True)
class Topic:
    """A topic of the graph.

    Attributes
    ----------
    name : str
        As the nodes use it: relative to their namespace, or with a leading slash.
    msgtype : str
        As rosbags writes it, ``package/msg/Type``.
    qos : rosbags.interfaces.Qos
    stream : Stream or None
        What its refused messages are counted as, where anybody refuses any.
    """

    name: str
    msgtype: str
    qos: Qos = STREAM_QOS
    stream: Stream | None = None

    @property
    def recorded(self) -> str:
        """Absolute name without namespace, as it stands in a bag."""
        return f"/{self.name.lstrip('/')}"

    @property
    def latched(self) -> bool:
        """Whether late subscribers are to get the last message."""
        return self.qos.durability is QosDurability.TRANSIENT_LOCAL


IMU = Topic("imu/data", "sensor_msgs/msg/Imu", stream=Stream.IMU)
TWIST = Topic("imu/twist", "geometry_msgs/msg/TwistWithCovarianceStamped", stream=Stream.TWIST)
FEATURES = Topic("stereo/features", "sensor_msgs/msg/PointCloud2", stream=Stream.FEATURES)
LEFT_CAMERA = Topic(
    "stereo/left/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED_QOS, Stream.CAMERA_INFO
)
RIGHT_CAMERA = Topic(
    "stereo/right/camera_info", "sensor_msgs/msg/CameraInfo", LATCHED_QOS, Stream.CAMERA_INFO
)
EXTRINSICS = Topic(
    "stereo/extrinsics", "geometry_msgs/msg/TransformStamped", LATCHED_QOS, Stream.EXTRINSICS
)
LEFT_IMAGE = Topic("stereo/left/image_raw", "sensor_msgs/msg/Image", stream=Stream.LEFT_IMAGE)
RIGHT_IMAGE = Topic("stereo/right/image_raw", "sensor_msgs/msg/Image", stream=Stream.RIGHT_IMAGE)
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
LEFT_COMPRESSED = Topic(
    "stereo/left/image_raw/compressed", COMPRESSED_IMAGE, stream=Stream.LEFT_IMAGE
)
RIGHT_COMPRESSED = Topic(
    "stereo/right/image_raw/compressed", COMPRESSED_IMAGE, stream=Stream.RIGHT_IMAGE
)
STATIC_TRANSFORMS = Topic("tf_static", "tf2_msgs/msg/TFMessage", LATCHED_QOS)
GROUND_TRUTH = Topic("ground_truth/odometry", "nav_msgs/msg/Odometry")

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
"""Of a drive, in the order in which messages of one stamp are written: what predicts before what
corrects."""

IMAGES = (LEFT_IMAGE, RIGHT_IMAGE, LEFT_COMPRESSED, RIGHT_COMPRESSED)
"""What stereo_tracker_node makes features of, in place of the features of a drive."""

RECTIFIED_CALIBRATION = (
    replace(LEFT_CAMERA, name="stereo/rectified/left/camera_info"),
    replace(RIGHT_CAMERA, name="stereo/rectified/right/camera_info"),
    replace(EXTRINSICS, name="stereo/rectified/extrinsics"),
)
"""Both camera infos and the extrinsics of the images as stereo_tracker_node has rectified them."""

TRACK_IMAGE = Topic("stereo/tracks/image", "sensor_msgs/msg/Image", NEWEST_QOS)
PREDICTION = Topic("prediction/odometry", "nav_msgs/msg/Odometry", stream=Stream.PREDICTION)
ODOMETRY = Topic("slam/odometry", "nav_msgs/msg/Odometry")
STEPS = Topic("slam/steps", "diagnostic_msgs/msg/DiagnosticArray")
GYRO_BIAS = Topic("slam/gyro_bias", "geometry_msgs/msg/Vector3Stamped")
LANDMARKS = Topic("slam/landmarks", "sensor_msgs/msg/PointCloud2", LATCHED_QOS)
PATH = Topic("slam/path", "nav_msgs/msg/Path")
PLAYER = Topic("player/status", "diagnostic_msgs/msg/DiagnosticArray", LATCHED_QOS)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
TRANSFORMS = Topic("/tf", "tf2_msgs/msg/TFMessage", VIEW_QOS)
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock")


PROVENANCE = "provenance.json"
"""File in a bag directory that says where the bag comes from."""

CHECKSUMS = "SHA256SUMS"
"""File in a bag directory with the SHA-256 of each other file, as ``sha256sum -c`` reads it."""


@dataclass(frozen=True)
class Frames:
    """Frame ids of messages, by the parameters ``map_frame``, ``odom_frame`` and so on.

    Both cameras' messages carry the left one's optical frame: the right projection matrix is
    relative to it.
    """

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    camera: str = "camera_left_optical"


DEFAULT_FRAMES = Frames()
