# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The IMU measures the motion that the images show, and nothing else but noise and bias."""

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.images.imu import GRAVITY, IMU_RATE, imu_samples
from vislam_ros.data.simulation.images.motion import SmoothMotion, room_poses
from vislam_ros.data.simulation.motion import drive_poses
from vislam_ros.data.trajectory import NANOSECONDS

BEGIN = 1_700_000_000_000_000_007
BIAS = (0.02, -0.01, 0.005)


def knots(kind):
    """Stamps and poses of some seconds of motion."""
    rng = np.random.default_rng(4)
    seconds = 0.05 * np.arange(101)
    if kind == "drive":
        poses = drive_poses(len(seconds), 0.05, rng)
    elif kind == "room":
        poses = room_poses(seconds, rng)
    else:
        poses = np.tile(se3.exp([1.0, 2.0, 3.0, 0.4, -0.2, 0.9]), (len(seconds), 1, 1))
    return BEGIN + np.rint(seconds * NANOSECONDS).astype(np.int64), poses


def sampled(motion, *, gyro=0.0, bias=(0.0, 0.0, 0.0), accelerometer=0.0):
    return imu_samples(
        motion,
        gyro_noise_density=gyro,
        gyro_bias=bias,
        accelerometer_noise_density=accelerometer,
        rng=np.random.default_rng(0),
    )


@pytest.mark.parametrize("kind", ["drive", "room", "rest"])
def test_a_motion_goes_through_its_poses(kind):
    stamps, poses = knots(kind)
    assert SmoothMotion(stamps, poses).poses(stamps) == pytest.approx(poses, abs=1e-9)


@pytest.mark.parametrize("kind", ["drive", "room"])
def test_angular_velocity_and_velocity_are_smooth_across_the_poses(kind):
    stamps, poses = knots(kind)
    imu = sampled(SmoothMotion(stamps, poses))
    # Without splines the rates would jump at every tenth sample, and stand between.
    for signal in (imu.angular_velocities, np.diff(imu.velocities, axis=0)):
        jumps = np.abs(np.diff(signal, axis=0))[2:]
        at_knots = jumps[np.arange(len(jumps)) % 10 == 7].mean()
        assert at_knots < 2 * jumps.mean()


@pytest.mark.parametrize("kind", ["drive", "room"])
def test_the_gyroscope_integrates_to_the_truth(kind):
    imu = sampled(SmoothMotion(*knots(kind)), bias=BIAS)
    R = imu.T_world_body[0, :3, :3]
    for k in range(1, len(imu.stamps)):
        tau = (imu.stamps[k] - imu.stamps[k - 1]) / NANOSECONDS
        R = R @ se3.exp_rotation((imu.angular_velocities[k] - BIAS) * tau)
    assert pytest.approx(imu.T_world_body[-1, :3, :3], abs=1e-9) == R
    turned = se3.log_rotation(imu.T_world_body[0, :3, :3].T @ R)
    assert np.linalg.norm(turned) > 0.1


@pytest.mark.parametrize("kind", ["drive", "room"])
def test_the_accelerometer_integrates_to_the_true_velocity_and_way(kind):
    imu = sampled(SmoothMotion(*knots(kind)))
    tau = 1 / IMU_RATE
    velocity, position = imu.velocities[0], imu.T_world_body[0, :3, 3]
    for k in range(1, len(imu.stamps)):
        middle = se3.interpolate(imu.T_world_body[k - 1], imu.T_world_body[k], 0.5)
        acceleration = middle[:3, :3] @ imu.accelerations[k] + GRAVITY
        position = position + velocity * tau + acceleration * tau**2 / 2
        velocity = velocity + acceleration * tau
    assert velocity == pytest.approx(imu.velocities[-1], abs=1e-6)
    assert position == pytest.approx(imu.T_world_body[-1, :3, 3], abs=5e-3)


def test_a_body_at_rest_measures_gravity_upward_in_its_own_axes():
    stamps, poses = knots("rest")
    imu = sampled(SmoothMotion(stamps, poses))
    assert imu.angular_velocities == pytest.approx(0, abs=1e-9)
    upward = -poses[0, :3, :3].T @ GRAVITY
    assert imu.accelerations == pytest.approx(np.tile(upward, (len(imu.stamps), 1)), abs=1e-6)


def test_noise_is_as_dense_as_it_says():
    motion = SmoothMotion(*knots("drive"))
    clean, noisy = sampled(motion), sampled(motion, gyro=1e-3, bias=BIAS, accelerometer=2e-2)
    gyro = noisy.angular_velocities - clean.angular_velocities - BIAS
    accelerometer = noisy.accelerations - clean.accelerations
    assert gyro.std() == pytest.approx(1e-3 * np.sqrt(IMU_RATE), rel=0.05)
    assert accelerometer.std() == pytest.approx(2e-2 * np.sqrt(IMU_RATE), rel=0.05)
    assert np.abs(gyro.mean(axis=0)).max() < 4 * gyro.std() / np.sqrt(len(gyro))
