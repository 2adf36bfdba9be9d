# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the filters estimate besides pose and map, each declared once."""

from vislam_ros.core.columns import Quantity

_XYZ = ("x", "y", "z")

VELOCITY = Quantity(
    "velocity",
    "m/s",
    "velocity of the body in its own axes over the step; where the estimator has none in its "
    "state, the prediction's",
    _XYZ,
)
ANGULAR_VELOCITY = Quantity(
    "angular_velocity", "rad/s", "angular velocity of the body in its own axes, likewise", _XYZ
)
GYRO_BIAS = Quantity("gyro_bias", "rad/s", "what the gyroscope reads too much", _XYZ)
LENS_DISTORTION = Quantity(
    "lens_distortion", "", "radial distortion that rectification has left (kappa)"
)
PIXEL_NOISE_STD = Quantity(
    "pixel_noise_std", "px", "noise of one pixel coordinate, as learned", has_std=False
)
VELOCITY_NOISE_STD = Quantity(
    "velocity_noise_std", "m/s", "noise of the measured velocity, as learned", has_std=False
)
ANGULAR_VELOCITY_NOISE_STD = Quantity(
    "angular_velocity_noise_std",
    "rad/s",
    "noise of the measured angular velocity, as learned",
    has_std=False,
)
VELOCITY_WALK_STD = Quantity(
    "velocity_walk_std",
    "m/s/sqrt(s)",
    "how fast the velocity changes, as learned",
    _XYZ,
    has_std=False,
)
ANGULAR_VELOCITY_WALK_STD = Quantity(
    "angular_velocity_walk_std",
    "rad/s/sqrt(s)",
    "how fast the angular velocity changes, as learned",
    _XYZ,
    has_std=False,
)

OF_EVERY_STEP = (VELOCITY, ANGULAR_VELOCITY)
OF_ROBOCENTRIC = (
    GYRO_BIAS,
    LENS_DISTORTION,
    PIXEL_NOISE_STD,
    VELOCITY_NOISE_STD,
    ANGULAR_VELOCITY_NOISE_STD,
    VELOCITY_WALK_STD,
    ANGULAR_VELOCITY_WALK_STD,
)
