# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An IMU that stands at its start levels the drive, from images, a bag or a file of tracks."""

import dataclasses

import numpy as np
import pytest
from places import SHARED_IMAGES

from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import GRAVITY, level_attitude
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.datasets import tracks_file
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import read_tum

EUROC = SHARED_IMAGES / "euroc_v101"
FORCE = GRAVITY * se3.exp_rotation([0.4, 0.3, 0.0])[2]


@pytest.fixture(scope="module")
def drive():
    """A drive by a gyroscope alone, of a body that stands for the first second."""
    made = simulate(SimulationSettings(steps=25, landmarks=150)).drive.moved_by("gyro")
    stamps = made.twist_stamps[0] + np.arange(250) * 10_000_000
    turns = np.zeros((250, 6))
    turns[:, :3] = np.nan
    turns[100:, 3:] = made.twists[1:16, 3:].repeat(10, axis=0)
    forces = np.tile(FORCE, (250, 1))
    forces[100:, 0] += 3.0
    forces[170] = np.nan
    return dataclasses.replace(made, twist_stamps=stamps, twists=turns, accelerations=forces)


def assert_same(solution, other):
    assert solution.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    assert solution.trajectory.quaternions.tobytes() == other.trajectory.quaternions.tobytes()


def test_the_first_pose_is_level_and_the_rest_of_the_drive_as_it_was(drive):
    found = solve(drive).trajectory.T_world_body
    flat = solve(dataclasses.replace(drive, accelerations=None)).trajectory.T_world_body
    T = np.eye(4)
    T[:3, :3] = level_attitude(FORCE)
    np.testing.assert_allclose(flat[0], np.eye(4), atol=1e-9)
    np.testing.assert_allclose(found, T @ flat, atol=1e-6)


def test_a_bag_keeps_the_accelerations_and_the_trajectory(drive, tmp_path):
    write_bag(drive, tmp_path / "bag")
    (read,) = read_passes(tmp_path / "bag")
    np.testing.assert_array_equal(read.accelerations, drive.accelerations)
    assert_same(solve(read), solve(drive))


def test_a_file_of_tracks_keeps_them_too(drive, tmp_path):
    tracks_file.write_tracks(tmp_path / "tracks.npz", drive)
    read = tracks_file.read(tmp_path / "tracks.npz")
    np.testing.assert_array_equal(read.accelerations, drive.accelerations)


def test_a_drive_without_an_accelerometer_has_none_in_its_bag(drive, tmp_path):
    write_bag(dataclasses.replace(drive, accelerations=None), tmp_path / "bag")
    (read,) = read_passes(tmp_path / "bag")
    assert read.accelerations is None


@pytest.mark.skipif(not EUROC.is_dir(), reason=f"{EUROC} is not there")
def test_a_real_drone_with_running_rotors_is_levelled_within_a_degree():
    drive = tracked_drive(read_images(EUROC))
    trajectory = solve(drive).trajectory
    truth = read_tum(EUROC / "truth.tum")
    assert trajectory.stamps[0] == truth.stamps[0]
    # The truth's world is level, with another yaw: upward in the body's axes is what both tell.
    up = trajectory.T_world_body[:, 2, :3]
    true_up = truth.T_world_body[: len(up), 2, :3]
    tilts = np.degrees(np.arccos(np.sum(up * true_up, axis=1)))
    assert tilts.max() < 1.0
    assert np.degrees(np.arccos(true_up[0, 2])) > 60.0, "far from where the body's axes point"
