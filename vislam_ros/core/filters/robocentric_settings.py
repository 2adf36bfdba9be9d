# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the robocentric filter."""

from dataclasses import dataclass

from vislam_ros.core.filters.settings import ObservationSettings
from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.core.settings import LARGEST_RATE, setting


@dataclass(frozen=True)
class RobocentricSettings(ObservationSettings):
    """Motion, bias, and how observations count; noise levels are where learning starts."""

    estimator: str = setting("robocentric", "Which filter runs")
    velocity_walk_std: float = setting(
        0.31,
        "Random walk of the velocity on each axis, white acceleration noise [m/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
        live=True,
    )
    angular_velocity_walk_std: float = setting(
        0.05,
        "Random walk of the angular velocity on each axis [rad/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
        live=True,
    )
    gyro_bias_std: float = setting(
        0.02,
        "Prior standard deviation of the gyroscope's bias on each axis, if there is one [rad/s]; "
        "0 means that there is none",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    gyro_bias_walk_std: float = setting(
        0.0,
        "Random walk of the gyroscope's bias [rad/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
        live=True,
    )
    learn_noise: bool = setting(
        True,
        "Learn the noise of the tracks and the twist's random walk as the filter goes; what is "
        "told is the start",
        live=True,
    )
    disparity_offset_std: float = setting(
        0.5,
        "Error of a disparity that stays for the life of its track [px], where the drive shows "
        "such errors; 0 means that there is none",
        minimum=0.0,
        maximum=LARGEST_PIXEL,
        live=True,
    )
    lens_distortion_std: float = setting(
        0.03,
        "Prior standard deviation of the radial distortion that rectification has left; 0 means "
        "that there is none",
        minimum=0.0,
        maximum=10.0,
    )
