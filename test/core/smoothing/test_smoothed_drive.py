# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose, assert_array_equal
from scenes import passing_scene

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.step import SlamStep
from vislam_ros.errors import SettingsError

STEP = 100_000_000
SCENE = passing_scene(31, steps=20)


def play(slam: Slam, first_stamp: int = 0, count: int = 20) -> list[SlamStep]:
    """Show a session the first frames of the scene."""
    steps, T = [], np.eye(4)
    slam.set_camera(CAMERA)
    for k in range(count):
        T = T @ SCENE.increments[k].T
        quaternion = se3.quaternion_from_rotation(T[:3, :3])
        slam.add_prediction(first_stamp + k * STEP, T[:3, 3], quaternion)
        frame = SCENE.frames[k]
        ids, pixels = frame.keys.astype(np.uint32), frame.pixels.astype(np.float32)
        steps += slam.add_features(first_stamp + k * STEP, ids, pixels)
    return steps


def session(**settings: float) -> Slam:
    return Slam(RobocentricSettings(chi2_gate=0.0, **settings), record=True)  # type: ignore[arg-type]


def test_every_step_has_a_smoothed_pose_and_the_last_is_the_filters() -> None:
    slam = session()
    steps = play(slam)
    smoothed = slam.smoothed()
    assert_array_equal(smoothed.stamps, [step.stamp for step in steps])
    assert_allclose(smoothed.positions[-1], steps[-1].position, rtol=0, atol=1e-12)
    assert_allclose(smoothed.quaternions[-1], steps[-1].quaternion, rtol=0, atol=1e-12)
    # But for the spread between the beliefs in a bias and in none, which lies in one direction.
    spread = np.linalg.eigvalsh(steps[-1].covariance - smoothed.covariances[-1])
    assert_allclose(spread[:-1], 0.0, rtol=0, atol=1e-12)
    assert spread[-1] > 1e-9
    shrunk = [
        np.trace(step.covariance - covariance)
        for step, covariance in zip(steps, smoothed.covariances, strict=True)
    ]
    assert min(shrunk) > -1e-12
    assert max(shrunk) > 1e-6


def test_where_there_is_one_model_the_last_covariance_is_the_filters() -> None:
    slam = session(gyro_bias_std=0.0)
    steps = play(slam)
    smoothed = slam.smoothed()
    assert_allclose(smoothed.covariances[-1], steps[-1].covariance, rtol=0, atol=1e-12)


def test_the_exact_map_holds_the_filters_landmarks_and_those_it_still_tracks_unchanged() -> None:
    # With two models a covariance may grow with what is learned: when one is no longer sure.
    slam = session(gyro_bias_std=0.0)
    active = play(slam)[-1].active
    exact, standing = slam.smoothed().landmarks, slam.landmarks()
    assert_array_equal(exact.ids, standing.ids)
    assert_array_equal(exact.generations, standing.generations)
    moved = np.any(exact.positions != standing.positions, axis=1)
    assert moved[:-active].mean() > 0.9
    assert not np.any(moved[-active:])
    assert_array_equal(exact.covariances[-active:], standing.covariances[-active:])
    traces = np.trace(standing.covariances - exact.covariances, axis1=1, axis2=2)
    assert np.all(traces[:-active] > -1e-9)


def test_it_can_be_asked_for_in_the_middle_of_a_drive() -> None:
    slam = session()
    play(slam, count=10)
    assert len(slam.smoothed().stamps) == 10


def test_it_covers_the_steps_since_the_estimate_began_anew() -> None:
    slam = session()
    play(slam, first_stamp=1000 * STEP)
    # A looping bag: time jumps back.
    second_pass = play(slam, count=8)
    assert slam.resets == 1
    smoothed = slam.smoothed()
    assert_array_equal(smoothed.stamps, [step.stamp for step in second_pass])
    assert len(smoothed.positions) == 8
    assert len(smoothed.landmarks) == second_pass[-1].landmarks


def test_the_map_of_a_pass_that_is_over_is_the_exact_one() -> None:
    slam = session()
    play(slam, first_stamp=1000 * STEP)
    standing, exact = slam.landmarks(), slam.smoothed().landmarks
    play(slam, count=8)
    assert slam.previous_map is not None
    assert_array_equal(slam.previous_map.ids, exact.ids)
    assert_array_equal(slam.previous_map.positions, exact.positions)
    assert np.any(exact.positions != standing.positions)


def test_a_landmark_without_a_position_is_no_part_of_the_exact_map() -> None:
    slam = session()
    slam.set_camera(CAMERA)
    slam.add_prediction(0, np.zeros(3), [0.0, 0.0, 0.0, 1.0])
    at_infinity = np.array([[300.0, 200.0, 299.9, 200.0]])
    frame = SCENE.frames[0]
    slam.add_features(
        0, [*frame.keys, 9999], np.concatenate([frame.pixels, at_infinity]).astype(np.float32)
    )
    play(slam, first_stamp=STEP, count=10)
    exact, standing = slam.smoothed().landmarks, slam.landmarks()
    assert_array_equal(exact.ids, standing.ids)
    assert 9999 not in exact.ids
    assert np.all(np.isfinite(exact.positions))
    assert np.any(exact.positions != standing.positions)


@pytest.mark.parametrize("estimator", ["robocentric", "joint"])
def test_recording_changes_no_bit_of_the_estimate(estimator: str) -> None:
    settings = SlamSettings(estimator=estimator)
    recorded, unrecorded = Slam(settings, record=True), Slam(settings)
    for one, other in zip(play(recorded), play(unrecorded), strict=True):
        assert one.position.tobytes() == other.position.tobytes()
        assert one.quaternion.tobytes() == other.quaternion.tobytes()
        assert one.covariance.tobytes() == other.covariance.tobytes()
    assert_array_equal(unrecorded.best_landmarks().positions, unrecorded.landmarks().positions)
    assert_array_equal(
        recorded.best_landmarks().positions, recorded.smoothed().landmarks.positions
    )


def test_before_the_first_frame_there_is_nothing() -> None:
    smoothed = session().smoothed()
    assert smoothed.positions.shape == (0, 3)
    assert smoothed.quaternions.shape == (0, 4)
    assert len(smoothed.landmarks) == 0


def test_an_estimator_that_records_nothing_is_refused_by_name() -> None:
    with pytest.raises(SettingsError, match="'mapping' cannot be smoothed; use"):
        Slam(SlamSettings(estimator="mapping"), record=True)


def test_a_session_that_was_not_told_to_record_says_so() -> None:
    with pytest.raises(ValueError, match="record=True"):
        Slam(SlamSettings()).smoothed()
