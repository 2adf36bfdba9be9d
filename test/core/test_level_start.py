# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The map stands as an odometry frame does that stands, and else as the body did."""

import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from scenes import passing_scene

from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.filters.registry import estimator_named, estimator_names
from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import LARGEST_GYRO_OFFSET, level_attitude
from vislam_ros.core.settings import MotionSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.tracking.pairing import PredictedPath

STEP = 100_000_000
SCENE = passing_scene(21, steps=12)
LEVEL = np.eye(4)
LEVEL[:3, :3] = level_attitude(np.array([0.3, -0.2, 0.9]))
NAMES = [name for name in estimator_names() if not estimator_named(name).needs_map]


def played(T_first, *, estimator="robocentric", record=False, reset_at=None, passes=1):
    """Session and steps of an odometry that begins at a pose."""
    slam = Slam(slam_settings({"estimator": estimator}), record=record)
    slam.set_camera(CAMERA)
    steps = []
    for number in range(passes):
        T = T_first[number] if isinstance(T_first, list) else T_first
        for k, (increment, frame) in enumerate(zip(SCENE.increments, SCENE.frames, strict=True)):
            if k == reset_at:
                slam.reset()
            T = T @ increment.T
            stamp = (k + 1) * STEP
            pose = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])
            steps += slam.add_prediction(stamp, *pose)
            features = frame.keys.astype(np.uint32), frame.pixels.astype(np.float32)
            steps += slam.add_features(stamp, *features)
    return slam, steps


def poses(steps):
    return np.array([se3.pose_matrix(step.position, step.quaternion) for step in steps])


@pytest.mark.parametrize("estimator", NAMES)
def test_the_estimate_is_the_same_one_turned(estimator):
    flat, level = (played(T, estimator=estimator) for T in (np.eye(4), LEVEL))
    assert_allclose(poses(level[1]), LEVEL @ poses(flat[1]), atol=1e-7)
    (ours, theirs) = (slam.landmarks().positions for slam in (level[0], flat[0]))
    assert ours.shape == theirs.shape
    assert_allclose(ours, theirs @ LEVEL[:3, :3].T, rtol=1e-5, atol=1e-5)


def test_the_smoothed_poses_are_turned_as_well():
    flat, level = (played(T, record=True)[0].smoothed() for T in (np.eye(4), LEVEL))
    found = se3.pose_matrix(level.positions, level.quaternions)
    expected = LEVEL @ se3.pose_matrix(flat.positions, flat.quaternions)
    assert_allclose(found, expected, atol=1e-6)


def test_place_and_yaw_begin_at_zero():
    elsewhere = se3.exp([5.0, -3.0, 1.0, 0.0, 0.0, 0.0])
    turned = np.eye(4)
    turned[:3, :3] = se3.exp_rotation([0.0, 0.0, 2.0])
    _, ours = played(elsewhere @ turned @ LEVEL)
    _, theirs = played(LEVEL)
    assert_allclose(poses(ours), poses(theirs), atol=1e-7)


@pytest.mark.parametrize("T_first", [np.eye(4), LEVEL])
def test_after_a_reset_the_map_stands_as_before(T_first):
    _, steps = played(T_first, reset_at=6)
    first = poses([next(step for step in steps[6:] if step.first_of_pass)])[0]
    if np.array_equal(T_first, np.eye(4)):
        assert_allclose(first, np.eye(4), atol=1e-12)
    else:
        assert np.degrees(np.arccos(first[2, :3] @ LEVEL[2, :3])) < 5.0
        assert abs(first[1, 0]) < 1e-12


def test_each_pass_tells_how_its_odometry_stands():
    _, steps = played([LEVEL, np.eye(4)], passes=2)
    first, second = (step for step in steps if step.first_of_pass)
    assert_allclose(poses([first])[0], LEVEL, atol=1e-7)
    assert_allclose(poses([second])[0], np.eye(4), atol=1e-12)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_what_turns_no_faster_than_an_offset_has_not_turned(factor):
    path = PredictedPath(MotionSettings())
    turn = se3.exp([0.0, 0.0, 0.0, 2.0 * factor * LARGEST_GYRO_OFFSET, 0.0, 0.0])
    path.add(0, LEVEL)
    path.add(2_000_000_000, LEVEL @ turn)
    stands = LEVEL if factor < 1.0 else LEVEL @ turn
    expected = level_attitude(stands[2, :3])
    assert_allclose(path.start(2_000_000_000)[:3, :3], expected, atol=1e-12)
    assert_allclose(path.start(0)[:3, :3], LEVEL[:3, :3], atol=1e-12)
