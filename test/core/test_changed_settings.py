# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings that change while a session runs: from the next step on, and only those that may."""

import dataclasses

import numpy as np
import pytest
from numerics import CAMERA
from scenes import passing_scene

from vislam_ros.core.filters.dead_reckoning import DeadReckoningEstimator
from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.filters.registry import estimator_named, estimator_names, register_estimator
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings, is_live, setting
from vislam_ros.core.slam import Slam
from vislam_ros.errors import SettingsError

STEP = 100_000_000
SCENE = passing_scene(5, steps=14)
CHANGE_AT = 7


def play(slam, change_at=None, **values):
    """Take the scene's frames, other settings before one of them; return the steps."""
    T, steps = np.eye(4), []
    for k, (increment, frame) in enumerate(zip(SCENE.increments, SCENE.frames, strict=True)):
        if k == change_at:
            slam.change_settings(dataclasses.replace(slam.settings, **values))
        T = T @ increment.T
        slam.add_prediction(k * STEP, T[:3, 3].copy(), se3.quaternion_from_rotation(T[:3, :3]))
        steps += slam.add_features(k * STEP, frame.keys, frame.pixels.astype(np.float32))
    return steps


def session(estimator, **values):
    slam = Slam(slam_settings({"estimator": estimator, **values}))
    slam.set_camera(CAMERA)
    return slam


def same(a, b):
    return (
        np.array_equal(a.position, b.position)
        and np.array_equal(a.covariance, b.covariance)
        and (a.used, a.rejected, a.active) == (b.used, b.rejected, b.active)
    )


OTHER = {
    "velocity_noise_std": 0.05,
    "angular_velocity_noise_std": 0.005,
    "retire_after": 3,
    "max_active": 6,
    "pixel_variance": (4.0, 4.0, 4.0, 4.0),
    "chi2_gate": 0.5,
    "pixel_gate": 0.05,
    "min_disparity": 60.0,
    "velocity_walk_std": 0.01,
    "angular_velocity_walk_std": 0.5,
    "gyro_bias_walk_std": 0.1,
    "learn_noise": False,
}


@pytest.mark.parametrize(
    ("estimator", "name"),
    [
        *(("robocentric", name) for name in OTHER if name != "min_disparity"),
        *(
            (estimator, name)
            for estimator in ("joint", "block_diagonal", "mapping")
            for name in ("pixel_variance", "chi2_gate", "min_disparity", "max_active")
        ),
        ("joint", "velocity_noise_std"),
        ("dead_reckoning", "angular_velocity_noise_std"),
    ],
)
def test_a_live_setting_changes_the_next_step_and_none_before(estimator, name):
    unchanged = play(session(estimator))
    changed = play(session(estimator), CHANGE_AT, **{name: OTHER[name]})
    agree = [same(a, b) for a, b in zip(unchanged, changed, strict=True)]
    assert all(agree[:CHANGE_AT])
    assert not all(agree[CHANGE_AT:])


def test_settings_that_are_told_before_the_first_step_are_those_of_the_whole_run():
    from_start = play(session("robocentric", pixel_variance=(4.0,) * 4, chi2_gate=3.0))
    told = play(session("robocentric"), 0, pixel_variance=(4.0,) * 4, chi2_gate=3.0)
    assert all(map(same, from_start, told))


def test_telling_the_same_settings_again_changes_nothing():
    told = play(session("robocentric"), CHANGE_AT, chi2_gate=RobocentricSettings.chi2_gate)
    assert all(map(same, play(session("robocentric")), told))


def test_a_frame_that_waits_is_taken_with_what_was_told_meanwhile():
    """What counts is the step, not when the features came."""
    slam, T, steps = session("robocentric"), np.eye(4), []
    for k, frame in enumerate(SCENE.frames):
        slam.add_features(k * STEP, frame.keys, frame.pixels.astype(np.float32))
    assert len(slam.waiting) == len(SCENE.frames)
    for k, increment in enumerate(SCENE.increments):
        if k == CHANGE_AT:
            slam.change_settings(dataclasses.replace(slam.settings, chi2_gate=0.5))
        T = T @ increment.T
        quaternion = se3.quaternion_from_rotation(T[:3, :3])
        steps += slam.add_prediction(k * STEP, T[:3, 3].copy(), quaternion)
    assert all(map(same, steps, play(session("robocentric"), CHANGE_AT, chi2_gate=0.5)))


def test_a_change_holds_after_a_reset():
    slam = session("robocentric")
    play(slam, CHANGE_AT, chi2_gate=0.5)
    slam.reset()
    again = play(slam)
    assert all(map(same, again, play(session("robocentric", chi2_gate=0.5))))


@pytest.mark.parametrize("estimator", estimator_names())
def test_what_is_not_live_is_refused_by_name_and_nothing_else_is_taken(estimator):
    settings = estimator_named(estimator).settings
    structural = {field.name for field in dataclasses.fields(settings) if not is_live(field)}
    assert {"estimator", "time_jump", "prior_pose_variance", "seed"} <= structural
    slam = Slam(slam_settings({"estimator": "joint"}))
    with pytest.raises(SettingsError, match=r"^time_jump: 2.0 cannot be set while"):
        slam.change_settings(dataclasses.replace(slam.settings, time_jump=2.0, chi2_gate=1.0))
    assert slam.settings == slam_settings({"estimator": "joint"})


@dataclasses.dataclass(frozen=True)
class FixedSettings(SlamSettings):
    estimator: str = "fixed"
    gate: float = setting(1.0, "A gate", live=True)


class FixedEstimator(DeadReckoningEstimator):
    def __init__(self, settings, given):
        super().__init__(settings)


def test_an_estimator_without_a_way_to_change_is_told_no():
    register_estimator("fixed", FixedSettings, FixedEstimator)
    slam = session("fixed")
    slam.change_settings(dataclasses.replace(slam.settings, gate=2.0))  # it is not made yet
    play(slam, CHANGE_AT, max_active=3)  # the session's own
    with pytest.raises(SettingsError, match=r"^gate: estimator 'fixed' takes no other value"):
        slam.change_settings(dataclasses.replace(slam.settings, gate=3.0))


def test_noise_that_is_told_anew_holds_at_once_and_is_learned_from_there():
    """Beside it what was learned of the other noises stays."""
    slam = session("robocentric")
    before = play(slam)[-1]
    settings = dataclasses.replace(slam.settings, pixel_variance=(9.0,) * 4, learn_noise=False)
    slam.change_settings(settings)
    after = replay(slam)
    assert after[0].row()["pixel_noise_std"] == pytest.approx(3.0)
    assert after[0].row()["velocity_walk_std_x"] == before.row()["velocity_walk_std_x"]


def replay(slam):
    """Go on after the scene's end with its last frame."""
    T = np.eye(4)
    for increment in SCENE.increments:
        T = T @ increment.T
    T = T @ SCENE.increments[-1].T
    stamp = len(SCENE.frames) * STEP
    slam.add_prediction(stamp, T[:3, 3].copy(), se3.quaternion_from_rotation(T[:3, :3]))
    frame = SCENE.frames[-1]
    return slam.add_features(stamp, frame.keys, frame.pixels.astype(np.float32) - 1)
