# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the robocentric filter."""

from dataclasses import dataclass

from vislam_ros.core.filters.settings import ObservationSettings
from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.core.settings import LARGEST_RATE, MOST_FRAMES, setting


@dataclass(frozen=True)
class RobocentricSettings(ObservationSettings):
    """Motion, biases, and how observations count; noise levels are where learning starts."""

    estimator: str = setting("robocentric", "Which filter runs")
    velocity_walk_std: float = setting(
        0.31,
        "Random walk of the velocity on each axis, white acceleration noise [m/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    angular_velocity_walk_std: float = setting(
        0.05,
        "Random walk of the angular velocity on each axis [rad/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    gyro_bias_std: float = setting(
        0.02,
        "Prior standard deviation of the gyroscope's bias on each axis [rad/s]; 0 means that "
        "there is none",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    gyro_bias_walk_std: float = setting(
        0.0,
        "Random walk of the gyroscope's bias [rad/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    velocity_bias_std: float = setting(
        0.3,
        "Prior standard deviation of the slow error of the measured velocity's y and z [m/s]; 0 "
        "means that there is none",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    velocity_bias_walk_std: float = setting(
        0.03,
        "Random walk of that error [m/s/sqrt(s)]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    slip_std: float = setting(
        0.25,
        "White noise of a vehicle's velocity across the direction it points in [m/s sqrt(s)]; 0 "
        "for bodies that move in any direction",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    axle_distance: float = setting(
        2.0,
        "How far from the body's origin, ahead or behind, the axle may be that does not slip [m]; "
        "turning sways the origin by as much times the turn rate",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    learn_noise: bool = setting(
        True,
        "Learn the noise of the tracks and the twist's random walk as the filter goes; what is "
        "told is the start",
    )
    disparity_offset_std: float = setting(
        0.5,
        "Error of a disparity that stays for the life of its track [px], where the drive shows "
        "such errors; 0 means that there is none",
        minimum=0.0,
        maximum=LARGEST_PIXEL,
    )
    disparity_prior: bool = setting(
        True,
        "Take the first disparity of a landmark with what those of the drive's others tell of it",
    )
    lens_distortion_std: float = setting(
        0.03,
        "Prior standard deviation of the radial distortion that rectification has left; 0 means "
        "that there is none",
        minimum=0.0,
        maximum=10.0,
    )
    min_observations: int = setting(
        8,
        "A frame that sees fewer known landmarks corrects nothing: a few cannot outvote a wrong "
        "one",
        minimum=1,
        maximum=MOST_FRAMES,
    )
    stale_disparity: float = setting(
        0.0,
        "Relative error of the disparity of a track that begins at a repeated pixel",
        minimum=0.0,
        maximum=10.0,
    )
