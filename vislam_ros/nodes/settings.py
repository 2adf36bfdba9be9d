# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the nodes themselves: frames, outputs, files. The filters' are in the core.

Nothing here needs ROS, so the command line can read the same parameter files.
"""

from dataclasses import dataclass

from vislam_ros.core.settings import LONGEST_TIME, setting


@dataclass(frozen=True)
class FrameSettings:
    """Names of the frames both estimating nodes use."""

    odom_frame: str = setting("odom", "Frame of the dead reckoning")
    base_frame: str = setting("base_link", "Frame of the body (the IMU)")


@dataclass(frozen=True)
class PredictionNodeSettings(FrameSettings):
    """Settings of imu_prediction_node beside those of the dead reckoning."""

    angular_velocity_source: str = setting(
        "twist",
        "Where the angular velocity comes from: twist takes it from imu/twist, imu from the "
        "imu/data message of the same stamp",
        choices=("twist", "imu"),
    )
    publish_tf: bool = setting(True, "Publish odom_frame -> base_frame on /tf")


@dataclass(frozen=True)
class SlamNodeSettings(FrameSettings):
    """Settings of slam_node that hold from its start to its end."""

    map_frame: str = setting("map", "Frame of the estimate")
    camera_frame: str = setting("camera_left_optical", "Frame of the stereo features")
    exact_map: bool = setting(
        True,
        "Record the drive (where the estimator can be smoothed), so that the map on request and "
        "at a pass's end is the exact one of the filter over all landmarks; takes some 50 kB a "
        "step, and the node does nothing else for some 5 ms a step while it goes back",
    )


@dataclass(frozen=True)
class SlamOutputSettings:
    """What slam_node publishes beside its odometry; may change while it runs."""

    publish_tf: bool = setting(
        True,
        "Publish map_frame -> odom_frame on /tf",
        live=True,
    )
    path_length: int = setting(
        1000,
        "Poses kept in slam/path; 0 turns the topic off",
        minimum=0,
        maximum=100_000,
        live=True,
    )
    landmarks_period: float = setting(
        1.0,
        "Publish slam/landmarks and slam/path at most once in this much data time, and no "
        "oftener by the clock; 0 publishes landmarks on request only [s]",
        minimum=0.0,
        maximum=LONGEST_TIME,
        live=True,
    )


@dataclass(frozen=True)
class TrackerNodeSettings:
    """Settings of stereo_tracker_node beside those of the tracker."""

    base_frame: str = setting("base_link", "Frame of the body (the IMU)")
    camera_frame: str = setting("camera_left_optical", "Frame of the left camera")
    compressed: bool = setting(
        False, "Take the images of .../compressed (PNG, JPEG) in place of those of image_raw"
    )
    images: str = setting(
        "auto",
        "What the images are: raw, as the lens makes them; rectified, so that of a camera info P "
        "alone counts; auto takes them for rectified where the topic's name says rect",
        choices=("auto", "raw", "rectified"),
    )
    gyroscope: str = setting(
        "auto",
        "Whether imu/data tells the tracker how far the camera has turned: never; required, so "
        "that every pair waits for its samples; auto, from the first sample on",
        choices=("auto", "required", "never"),
    )
    stamp_tolerance: float = setting(
        0.0,
        "Stamps of left and right by which they still are of one moment; 0 is half the time "
        "between two images [s]",
        minimum=0.0,
        maximum=LONGEST_TIME,
    )
    time_jump: float = setting(
        1.0,
        "A stamp further than this from the newest one is believed only with the next message "
        "near it, as that of slam_node [s]",
        minimum=0.0,
        maximum=LONGEST_TIME,
    )
    max_pending: int = setting(
        50,
        "Pairs that may wait for the gyroscope or the cameras, and images for their partner [-]",
        minimum=1,
        maximum=10_000,
    )
    queue_size: int = setting(
        10,
        "Images of each camera that may wait for the tracker to come to them; the oldest are "
        "lost. 0 keeps all, for bags [-]",
        minimum=0,
        maximum=100_000,
    )


@dataclass(frozen=True)
class RecorderSettings:
    """Settings of recorder_node."""

    directory: str = setting("", "Result directory to write; must not exist unless force is set")
    force: bool = setting(False, "Replace an existing result directory")
    record_mcap: bool = setting(True, "Write results.mcap beside the other files")
