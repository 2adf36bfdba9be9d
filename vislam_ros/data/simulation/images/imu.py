# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What an IMU measures along a motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.images.motion import SmoothMotion, Stamps
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

IMU_RATE = 200  # samples a second
#: In the world, whose z axis points up [m/s^2].
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class ImuSamples:
    """Samples of an IMU in the body's origin and axes, and the truth about them.

    A sample with stamp t is the mean over the time since the one before, so that angular
    velocities integrate to the attitude exactly, but for noise and bias. The first repeats the
    second's.

    Attributes
    ----------
    stamps : ndarray of int64, (n,)
        Nanoseconds.
    angular_velocities : ndarray, (n, 3)
        With noise and bias, rad/s.
    accelerations : ndarray, (n, 3)
        Specific force with noise, m/s^2: upward where the body rests.
    T_world_body : ndarray, (n, 4, 4)
        True poses.
    velocities : ndarray, (n, 3)
        True ones in the world, m/s.
    """

    stamps: Stamps
    angular_velocities: Array
    accelerations: Array
    T_world_body: Array
    velocities: Array


def imu_samples(
    motion: SmoothMotion,
    *,
    gyro_noise_density: float,
    gyro_bias: tuple[float, float, float],
    accelerometer_noise_density: float,
    rng: np.random.Generator,
) -> ImuSamples:
    """Sample a motion from its first to its last pose.

    Parameters
    ----------
    motion : SmoothMotion
    gyro_noise_density, accelerometer_noise_density : float
        White noise, rad/s and m/s^2, each for the square root of a hertz.
    gyro_bias : tuple of float, (3,)
        Constant error, rad/s.
    rng : Generator
    """
    step = NANOSECONDS // IMU_RATE
    stamps = np.arange(motion.first, motion.last + 1, step, dtype=np.int64)
    T = motion.poses(stamps)
    velocities = motion.velocities(stamps)
    tau = step / NANOSECONDS
    turns = se3.log_rotation(np.swapaxes(T[:-1, :3, :3], 1, 2) @ T[1:, :3, :3])
    R_middle = T[:-1, :3, :3] @ se3.exp_rotation(turns / 2)
    force = np.diff(velocities, axis=0) / tau - GRAVITY
    force = np.einsum("nji,nj->ni", R_middle, force)

    # White noise of density s has a mean over tau seconds with standard deviation s / sqrt(tau).
    noise = rng.standard_normal((2, len(stamps), 3)) / np.sqrt(tau)
    rates = np.concatenate([turns[:1], turns]) / tau
    return ImuSamples(
        stamps,
        rates + np.array(gyro_bias) + gyro_noise_density * noise[0],
        np.concatenate([force[:1], force]) + accelerometer_noise_density * noise[1],
        T,
        velocities,
    )
