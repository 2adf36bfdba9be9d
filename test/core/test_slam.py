# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numerics import CAMERA
from numpy.testing import assert_allclose
from scenes import passing_scene

from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.filters.quantities import GYRO_BIAS
from vislam_ros.core.filters.registry import estimator_names
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.errors import SettingsError

STEP = 100_000_000
SCENE = passing_scene(21, steps=12)


def messages(offset=0):
    """Predictions and features of a scene, as arguments of the session's methods."""
    T, predictions, features = np.eye(4), [], []
    for k, (increment, frame) in enumerate(zip(SCENE.increments, SCENE.frames, strict=True)):
        T = T @ increment.T
        stamp = offset + k * STEP
        predictions.append((stamp, T[:3, 3].copy(), se3.quaternion_from_rotation(T[:3, :3])))
        features.append((stamp, frame.keys.astype(np.uint32), frame.pixels.astype(np.float32)))
    return predictions, features


PREDICTIONS, FEATURES = messages()


def session(**values):
    slam = Slam(slam_settings(values))
    slam.set_camera(CAMERA)
    return slam


def play(slam, predictions=PREDICTIONS, features=FEATURES):
    steps = []
    for prediction, frame in zip(predictions, features, strict=True):
        steps += slam.add_prediction(*prediction)
        steps += slam.add_features(*frame)
    return steps


def same(steps, others):
    """Tell whether two lists of steps hold the same estimates, to the last bit."""
    return len(steps) == len(others) and all(
        a.stamp == b.stamp
        and np.array_equal(a.position, b.position)
        and np.array_equal(a.quaternion, b.quaternion)
        and np.array_equal(a.covariance, b.covariance)
        for a, b in zip(steps, others, strict=True)
    )


EXPECTED = play(session())


def test_each_features_message_gives_one_step_with_its_stamp():
    assert [step.stamp for step in EXPECTED] == [frame[0] for frame in FEATURES]
    assert [step.first_of_pass for step in EXPECTED] == [True] + [False] * 11


@pytest.mark.parametrize("estimator", [e for e in estimator_names() if e != "localization"])
def test_every_estimator_runs(estimator):
    steps = play(session(estimator=estimator))
    assert len(steps) == len(FEATURES)
    assert all(np.all(np.isfinite(step.position)) for step in steps)


def test_each_step_tells_the_gyro_bias_as_it_stood_where_the_estimator_has_one():
    rows = [step.row() for step in EXPECTED]
    biases, stds = (
        np.array([[row[name] for name in names] for row in rows])
        for names in (GYRO_BIAS.names, GYRO_BIAS.std_names)
    )
    # Most of the prior is at none.
    assert_allclose(stds[0], slam_settings({}).gyro_bias_std)
    assert np.all(stds[-1] < stds[0])
    assert len({bias.tobytes() for bias in biases}) > 1
    for step in play(session(estimator="joint")):
        assert step.estimates == ()


def test_each_step_tells_the_twist_and_how_well_it_is_known():
    truth = se3.log(se3.inverse(SCENE.T_world_body[-2]) @ SCENE.T_world_body[-1]) / 0.1
    spread = {}
    for estimator in ("robocentric", "joint", "dead_reckoning"):
        first, *_, last = play(session(estimator=estimator))
        # Before the first motion it may be any vehicle's.
        assert_allclose(first.twist, 0.0)
        assert np.all(first.twist_covariance.diagonal() >= 4.0)
        error = last.twist - truth
        assert error @ np.linalg.solve(last.twist_covariance, error) < 22.5  # 0.999 of 6 degrees
        spread[estimator] = np.sqrt(np.trace(last.twist_covariance))
    # Where the twist is in the state, vision tells of it.
    assert spread["joint"] == spread["dead_reckoning"] > 2 * spread["robocentric"]


def test_the_twist_of_an_estimator_without_one_is_the_prediction_s_with_its_noise():
    step = play(session(estimator="dead_reckoning", velocity_noise_std=0.3))[-1]
    assert_allclose(step.twist, se3.log(SCENE.increments[-1].T) / (STEP * 1e-9), atol=1e-6)
    assert_allclose(np.sqrt(step.twist_covariance.diagonal()[:3]), 0.3, rtol=0.01)


@settings(max_examples=25, deadline=None)
@given(st.randoms(use_true_random=False))
def test_the_order_of_arrival_between_the_streams_changes_nothing(random):
    order = ["prediction"] * len(PREDICTIONS) + ["features"] * len(FEATURES)
    random.shuffle(order)
    predictions, features = iter(PREDICTIONS), iter(FEATURES)
    slam, steps = session(), []
    for kind in order:
        if kind == "prediction":
            steps += slam.add_prediction(*next(predictions))
        else:
            steps += slam.add_features(*next(features))
    assert same(steps, EXPECTED)
    assert not slam.waiting


def test_features_wait_for_the_camera():
    slam = Slam(SlamSettings())
    assert play(slam) == []
    assert same(slam.set_camera(CAMERA), EXPECTED)


def test_a_changed_camera_holds_from_the_next_pass_on():
    slam, steps = session(), []
    other = dataclasses.replace(CAMERA, fx=CAMERA.fx + 50.0, fx_baseline=CAMERA.fx_baseline * 1.5)
    for k, (prediction, frame) in enumerate(zip(PREDICTIONS, FEATURES, strict=True)):
        assert slam.has_begun == (k > 1)
        if k == 6:
            slam.set_camera(other)
        steps += slam.add_prediction(*prediction)
        steps += slam.add_features(*frame)
    assert same(steps, EXPECTED)
    slam.reset()
    assert not slam.has_begun
    with_other = Slam(SlamSettings())
    with_other.set_camera(other)
    assert same(play(slam), play(with_other))


def test_a_lost_prediction_loses_no_step():
    slam, steps = session(), []
    for k, (prediction, frame) in enumerate(zip(PREDICTIONS, FEATURES, strict=True)):
        if k != 5:
            steps += slam.add_prediction(*prediction)
        steps += slam.add_features(*frame)
    assert [step.stamp for step in steps] == [step.stamp for step in EXPECTED]
    assert_allclose(steps[-1].position, EXPECTED[-1].position, atol=0.05)
    assert not slam.refused.counts


def test_the_map_to_odom_transform_carries_the_prediction_to_the_estimate():
    for step, prediction in zip(EXPECTED, PREDICTIONS, strict=True):
        T_map_body = step.T_map_odom @ se3.pose_matrix(prediction[1], prediction[2])
        assert_allclose(T_map_body, se3.pose_matrix(step.position, step.quaternion), atol=1e-12)


IDS = np.array([1, 2], dtype=np.uint32)
PIXELS = np.array([[500, 100, 480, 100], [600, 120, 570, 120]], dtype=np.float32)


@pytest.mark.parametrize(
    ("stamp", "ids", "pixels", "reason"),
    [
        (11 * STEP, IDS, PIXELS, "duplicate"),
        (10 * STEP + 1, IDS, PIXELS, "late"),
        (12 * STEP, IDS, PIXELS * np.nan, "non_finite"),
        (12 * STEP, IDS, PIXELS[:1], "wrong_size"),
        (12 * STEP, IDS[:1], PIXELS, "wrong_size"),
        (12 * STEP, IDS, PIXELS[:, :3], "wrong_size"),
        (12 * STEP, IDS * 0, PIXELS, "duplicate_ids"),
    ],
)
def test_bad_features_are_refused_by_reason_and_change_nothing(stamp, ids, pixels, reason):
    slam = session()
    play(slam)
    assert slam.add_features(stamp, ids, pixels) == []
    assert slam.refused.counts == {f"features_{reason}": 1}
    assert slam.refused.first_stamps == {f"features_{reason}": stamp}
    plain = session()
    play(plain)
    last = (12 * STEP, IDS, PIXELS)
    pose = (12 * STEP, *PREDICTIONS[-1][1:])
    assert same(
        slam.add_prediction(*pose) + slam.add_features(*last),
        plain.add_prediction(*pose) + plain.add_features(*last),
    )


@pytest.mark.parametrize(
    ("stamp", "position", "quaternion", "reason"),
    [
        (11 * STEP, [0, 0, 0], [0, 0, 0, 1], "prediction_duplicate"),
        (10 * STEP + 1, [0, 0, 0], [0, 0, 0, 1], "prediction_late"),
        (12 * STEP, [0, 0, np.nan], [0, 0, 0, 1], "prediction_non_finite"),
        (12 * STEP, [0, 0], [0, 0, 0, 1], "prediction_wrong_size"),
        (12 * STEP, [0, 0, 0], [0, 0, 0, 0], "prediction_not_a_rotation"),
    ],
)
def test_a_bad_prediction_is_refused_by_reason(stamp, position, quaternion, reason):
    slam = session()
    play(slam)
    assert slam.add_prediction(stamp, position, quaternion) == []
    assert slam.refused.counts == {reason: 1}


def test_a_frame_before_the_first_prediction_is_refused():
    slam = session()
    slam.add_features(*FEATURES[0])
    slam.add_features(*FEATURES[1])
    assert slam.add_prediction(*PREDICTIONS[1]) == []
    assert [step.stamp for step in slam.add_prediction(*PREDICTIONS[2])] == [STEP]
    assert slam.refused.counts == {"features_no_prediction": 1}


def test_frames_beyond_the_queue_are_refused():
    slam = session(max_pending=2)
    for frame in FEATURES[:4]:
        slam.add_features(*frame)
    assert slam.refused.counts == {"features_queue_full": 2}
    assert slam.waiting == (FEATURES[0][0], FEATURES[1][0])


def test_what_would_be_refused_at_the_end_is_named():
    slam = session()
    play(slam)
    for stamp in (12 * STEP, 13 * STEP, 100 * STEP):
        slam.add_features(stamp, IDS, PIXELS)
    slam.add_prediction(200 * STEP, *PREDICTIONS[-1][1:])
    assert slam.waiting == (12 * STEP, 13 * STEP, 100 * STEP)
    over = slam.refused_if_over
    assert over.counts == {
        "features_no_prediction": 2,
        "features_bad_stamp": 1,
        "prediction_bad_stamp": 1,
    }
    assert over.first_stamps["features_no_prediction"] == 12 * STEP
    assert over.first_stamps["features_bad_stamp"] == 100 * STEP
    assert not slam.refused.counts
    blind = Slam(SlamSettings())
    play(blind)
    assert blind.refused_if_over.counts == {"features_no_camera": len(FEATURES)}


LATER = 1000 * STEP


@pytest.mark.parametrize("first", ["prediction", "features"])
def test_time_jumping_back_begins_anew_whichever_stream_jumps_first(first):
    slam = session()
    play(slam, *messages(LATER))
    steps = []
    for prediction, frame in zip(PREDICTIONS[:2], FEATURES[:2], strict=True):
        if first == "prediction":
            steps += slam.add_prediction(*prediction) + slam.add_features(*frame)
        else:
            steps += slam.add_features(*frame) + slam.add_prediction(*prediction)
    steps += play(slam, PREDICTIONS[2:], FEATURES[2:])
    assert same(steps, EXPECTED)
    assert steps[0].first_of_pass
    assert slam.resets == 1
    assert not slam.refused.counts


def test_frames_left_from_before_a_jump_are_refused_not_mixed_in():
    slam = session()
    predictions, features = messages(LATER)
    play(slam, predictions[:-1], features[:-1])
    slam.add_features(*features[-1])
    assert same(play(slam), EXPECTED)
    assert slam.refused.counts == {"features_no_prediction": 1}


def test_a_session_that_joins_after_the_predictions_jumped_still_pairs():
    slam = session()
    for prediction in messages(LATER)[0]:
        slam.add_prediction(*prediction)
    assert same(play(slam), EXPECTED)


def test_the_map_of_a_pass_is_kept_when_the_next_begins():
    slam = session()
    play(slam, *messages(LATER))
    whole = slam.landmarks()
    play(slam)
    assert_allclose(slam.previous_map.positions, whole.positions)


def test_reset_begins_anew_and_keeps_the_camera():
    slam = session()
    play(slam)
    slam.reset()
    assert len(slam.landmarks()) == 0
    assert same(play(slam), EXPECTED)
    assert slam.resets == 1


def test_landmarks_bear_the_ids_and_generations_of_their_tracks():
    slam = session()
    play(slam)
    landmarks = slam.landmarks()
    assert len(landmarks) == len(np.unique(landmarks.ids)) == EXPECTED[-1].landmarks
    assert not landmarks.generations.any()
    truth = SCENE.landmarks[landmarks.ids]
    assert np.median(np.linalg.norm(landmarks.positions - truth, axis=1)) < 1.0


def test_a_frozen_frame_begins_its_tracks_anew():
    frozen = [*FEATURES[:6], (FEATURES[6][0], *FEATURES[5][1:]), *FEATURES[7:]]
    slam = session()
    steps = play(slam, PREDICTIONS, frozen)
    assert [step.frozen for step in steps] == [False] * 6 + [True] + [False] * 5
    assert steps[6].used == 0
    begun_anew = slam.landmarks().ids[slam.landmarks().generations == 1]
    assert set(FEATURES[5][1]) <= set(begun_anew)
    off = session(track_continuity=False)
    assert not any(step.frozen for step in play(off, PREDICTIONS, frozen))


def frames_with(disturbed):
    """The features, in frame 6 and later with the pixels of some landmarks moved across."""
    return [
        (stamp, ids, pixels + np.float32(40.0) * np.isin(ids, disturbed)[:, None])
        if k >= 6
        else (stamp, ids, pixels)
        for k, (stamp, ids, pixels) in enumerate(FEATURES)
    ]


def test_a_landmark_that_is_rejected_rests_and_the_others_go_on():
    # One that is first seen in frame 5 and last in frame 10.
    steps = play(session(rest_after_rejection=3), features=frames_with(FEATURES[5][1][-1:]))
    assert steps[6].rejected == EXPECTED[6].rejected + 1
    left_out = [step.observed - step.used - step.rejected - step.admitted for step in steps]
    assert left_out[6:] == [0, 1, 1, 1, 0, 0]
    # What is left out counts as observed.
    assert [step.observed for step in steps] == [step.observed for step in EXPECTED]


def test_an_estimate_that_most_landmarks_contradict_is_mended_by_them():
    steps = play(session(), features=frames_with(FEATURES[5][1]))
    assert steps[6].rejected > steps[6].used
    assert steps[7].admitted > 0.5 * steps[7].observed
    assert steps[8].used > 0.5 * steps[8].observed


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.7, 1.0])
def test_a_share_of_the_tracks_is_chosen_by_id(fraction):
    ids = np.arange(20000, dtype=np.uint32)
    pixels = np.tile(np.array([[500, 100, 480, 100]], dtype=np.float32), (len(ids), 1))
    slam = session(feature_fraction=fraction, estimator="dead_reckoning")
    for prediction in PREDICTIONS[:2]:
        slam.add_prediction(*prediction)
    slam.add_features(0, ids, pixels)
    observed = slam.add_features(STEP, ids, pixels)[0].observed
    assert observed / len(ids) == pytest.approx(fraction, abs=0.01)


def test_the_seed_changes_the_choice():
    def kept(seed):
        slam = session(feature_fraction=0.5, seed=seed)
        play(slam)
        return set(slam.landmarks().ids.tolist())

    assert kept(1) == kept(1)
    assert kept(1) != kept(2)


def test_localization_needs_a_map_and_uses_it():
    with pytest.raises(SettingsError, match="needs a map"):
        Slam(SlamSettings(estimator="localization"))
    mapper = session()
    play(mapper)
    slam = Slam(SlamSettings(estimator="localization"), mapper.landmarks())
    slam.set_camera(CAMERA)
    steps = play(slam)
    assert sum(step.used for step in steps) > 100
    error = np.linalg.norm(steps[-1].position - SCENE.T_world_body[-1][:3, 3])
    drift = np.linalg.norm(PREDICTIONS[-1][1] - SCENE.T_world_body[-1][:3, 3])
    assert error < drift


def test_a_step_is_plain_data():
    assert dataclasses.is_dataclass(EXPECTED[0])
    assert EXPECTED[3].observed == len(FEATURES[3][1])
    assert EXPECTED[3].nis_dof == 3 * EXPECTED[3].used
    assert EXPECTED[3].ms > 0
