# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import copy

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.data.bags import decoding, layout
from vislam_ros.data.bags.layout import DEFAULT_FRAMES
from vislam_ros.data.results.landmark_map import write_landmarks
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.slam_node import SlamNode
from vislam_ros.nodes.slam_report import row_from_values

ODOMETRY, STEPS, LANDMARKS, GYRO_BIAS, DIAGNOSTICS = (
    topic.recorded
    for topic in (
        layout.ODOMETRY,
        layout.STEPS,
        layout.LANDMARKS,
        layout.GYRO_BIAS,
        layout.DIAGNOSTICS,
    )
)


def send(node, topic, message):
    """Give a node a message as it comes from the wire."""
    node.monitor.take(topic, serialize_message(message))


@pytest.fixture
def node(make_node):
    return make_node(SlamNode)


def offline(drive):
    core = Slam(SlamSettings())
    core.set_camera(drive.camera)
    steps = []
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        steps += core.add_prediction(*decoding.pose(prediction))
        steps += core.add_features(*decoding.features(features, DEFAULT_FRAMES))
    return steps


def assert_same_poses(odometries, steps):
    assert len(odometries) == len(steps)
    for message, step in zip(odometries, steps, strict=True):
        stamp, position, quaternion = decoding.pose(message)
        assert stamp == step.stamp
        assert position.tobytes() == step.position.tobytes()
        assert quaternion.tobytes() == step.quaternion.tobytes()


def predictions_first(drive, node):
    drive.calibrate(node)
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        node.on_prediction(prediction)
        node.on_features(features)


def features_first(drive, node):
    drive.calibrate(node)
    for prediction, features in zip(drive.predictions, drive.features, strict=True):
        node.on_features(features)
        node.on_prediction(prediction)


def camera_last(drive, node):
    for features in drive.features:
        node.on_features(features)
    for prediction in drive.predictions:
        node.on_prediction(prediction)
    drive.calibrate(node)


@pytest.mark.parametrize("give", [predictions_first, features_first, camera_last])
def test_odometry_is_the_core_s_bit_for_bit_in_whatever_order_messages_come(
    node, capture, drive, give
):
    published = capture(node)
    give(drive, node)
    assert_same_poses(published[ODOMETRY], offline(drive))
    assert {message.header.frame_id for message in published[ODOMETRY]} == {"map"}
    assert {message.child_frame_id for message in published[ODOMETRY]} == {"base_link"}
    assert not node.monitor.refused.counts


def test_each_step_is_told_with_the_stamp_of_its_features(node, capture, drive):
    published = capture(node)
    predictions_first(drive, node)
    steps = offline(drive)
    assert len(published[STEPS]) == len(steps)
    for message, step in zip(published[STEPS], steps, strict=True):
        values = conversions.status_values(message, "slam_step")
        assert decoding.stamp_of(message.header) == step.stamp
        row, latency_ms, _ = row_from_values(values)
        assert row["stamp"] == step.stamp
        assert {**row, "ms": 0.0} == {**step.row(), "ms": 0.0}
        assert latency_ms >= row["ms"]
    values = conversions.status_values(published[STEPS][0], "slam_step")
    assert row_from_values(values)[0]["first_of_pass"] is True


def test_what_a_step_did_is_told_before_its_pose(node, monkeypatch, drive):
    """So no pose is without, where the node is killed between the two."""
    told = []
    monkeypatch.setattr(node.monitor, "publish", lambda to, _: told.append(to.topic_name))
    predictions_first(drive, node)
    assert [name for name in told if name in (STEPS, ODOMETRY)] == len(drive.features) * [
        STEPS,
        ODOMETRY,
    ]


def test_refused_features_are_counted_and_the_next_ones_go_on(node, capture, drive):
    published = capture(node)
    drive.calibrate(node)
    for prediction in drive.predictions:
        node.on_prediction(prediction)

    ids, pixels = decoding.features(drive.features[4], DEFAULT_FRAMES)[1:3]
    not_finite = pixels.copy()
    not_finite[3, 1] = np.nan
    twice = np.zeros_like(ids)
    cut = copy.deepcopy(drive.features[4])
    cut.data = cut.data[:-3]
    unnamed = copy.deepcopy(drive.features[4])
    unnamed.fields = unnamed.fields[1:]
    elsewhere = copy.deepcopy(drive.features[4])
    elsewhere.header.frame_id = "base_link"
    for message in (
        drive.features[0],
        drive.features[2],
        drive.features[2],
        drive.features[1],
        conversions.features_to_message(drive.stamps[4], "camera_left_optical", ids, not_finite),
        conversions.features_to_message(drive.stamps[4], "camera_left_optical", twice, pixels),
        cut,
        unnamed,
        elsewhere,
        drive.features[4],
    ):
        send(node, layout.FEATURES, message)
    assert len(published[ODOMETRY]) == 3
    assert node.monitor.refused.counts == {
        "features_duplicate": 1,
        "features_late": 1,
        "features_non_finite": 1,
        "features_duplicate_ids": 1,
        "features_wrong_size": 1,
        "features_bad_fields": 1,
        "features_unknown_frame": 1,
    }


def test_refused_predictions_are_counted(node, capture, drive):
    published = capture(node)
    drive.calibrate(node)
    not_finite = copy.deepcopy(drive.predictions[1])
    not_finite.pose.pose.position.x = float("inf")
    no_rotation = copy.deepcopy(drive.predictions[1])
    no_rotation.pose.pose.orientation.w = 0.0
    no_rotation.pose.pose.orientation.z = 0.0
    elsewhere = copy.deepcopy(drive.predictions[1])
    elsewhere.child_frame_id = "wheel"
    for message in (drive.predictions[0], not_finite, no_rotation, elsewhere):
        send(node, layout.PREDICTION, message)
    send(node, layout.PREDICTION, drive.predictions[0])
    send(node, layout.PREDICTION, drive.predictions[1])
    for features in drive.features[:2]:
        node.on_features(features)
    assert len(published[ODOMETRY]) == 2
    assert node.monitor.refused.counts == {
        "prediction_unknown_frame": 1,
        "prediction_non_finite": 1,
        "prediction_not_a_rotation": 1,
        "prediction_duplicate": 1,
    }


def test_a_lost_prediction_is_bridged_by_its_neighbours(node, capture, drive):
    published = capture(node)
    drive.calibrate(node)
    for k, (prediction, features) in enumerate(
        zip(drive.predictions, drive.features, strict=True)
    ):
        if k != 5:
            node.on_prediction(prediction)
        node.on_features(features)
    assert len(published[ODOMETRY]) == len(drive.features)
    for message, step in zip(published[ODOMETRY], offline(drive), strict=True):
        _, position, _ = decoding.pose(message)
        np.testing.assert_allclose(position, step.position, atol=1e-3)


def test_time_that_jumps_back_begins_a_new_pass(node, capture, drive):
    published = capture(node)
    predictions_first(drive, node)
    predictions_first(drive, node)
    steps = offline(drive)
    assert_same_poses(published[ODOMETRY], steps + steps)
    assert node.core.resets == 1
    # The map of the first pass went out when the second one began.
    stamps = [decoding.stamp_of(m.header) for m in published[LANDMARKS]]
    assert drive.stamps[-1] in stamps


def test_the_reset_service_begins_anew_with_the_next_features(node, capture, drive):
    published = capture(node)
    drive.calibrate(node)
    half = len(drive.stamps) // 2
    for k in range(half):
        node.on_prediction(drive.predictions[k])
        node.on_features(drive.features[k])
    node.reset()
    for k in range(half, len(drive.stamps)):
        node.on_prediction(drive.predictions[k])
        node.on_features(drive.features[k])
    assert len(published[ODOMETRY]) == len(drive.stamps)
    _, position, quaternion = decoding.pose(published[ODOMETRY][half])
    np.testing.assert_array_equal(position, 0.0)
    np.testing.assert_array_equal(quaternion, [0, 0, 0, 1])


def test_landmarks_go_out_on_request_with_the_stamp_of_the_last_step(node, capture, drive):
    published = capture(node)
    with pytest.raises(VislamError, match="no step"):
        node.publish_landmarks()
    predictions_first(drive, node)
    node.publish_landmarks()
    message = published[LANDMARKS][-1]
    assert decoding.stamp_of(message.header) == drive.stamps[-1]
    landmarks = conversions.landmarks_from_message(message)
    expected = node.core.smoothed().landmarks
    np.testing.assert_array_equal(landmarks.ids, expected.ids)
    np.testing.assert_array_equal(landmarks.positions, expected.positions.astype(np.float32))


def losing_tracks(drive, node):
    """Give the drive to a node, three tracks fewer at each frame."""
    drive.calibrate(node)
    for k, (prediction, features) in enumerate(
        zip(drive.predictions, drive.features, strict=True)
    ):
        node.on_prediction(prediction)
        stamp, ids, pixels, _ = decoding.features(features, DEFAULT_FRAMES)
        node.on_features(
            conversions.features_to_message(
                stamp, "camera_left_optical", ids[3 * k :], pixels[3 * k :]
            )
        )


@pytest.mark.parametrize("exact", [True, False])
def test_the_map_on_request_is_the_exact_one_unless_a_parameter_says_no(
    make_node, capture, drive, exact
):
    node = make_node(SlamNode, exact_map=exact, chi2_gate=0.0)
    published = capture(node)
    losing_tracks(drive, node)
    node.publish_landmarks()
    landmarks = conversions.landmarks_from_message(published[LANDMARKS][-1])
    standing = node.core.landmarks()
    np.testing.assert_array_equal(landmarks.ids, standing.ids)
    same = np.all(landmarks.positions == standing.positions.astype(np.float32), axis=1)
    assert same.all() != exact
    # The map that goes out when a pass is over is the same.
    losing_tracks(drive, node)
    last_of_pass = conversions.landmarks_from_message(published[LANDMARKS][-1])
    np.testing.assert_array_equal(last_of_pass.positions, landmarks.positions)


def test_what_is_recorded_for_the_exact_map_changes_no_bit_of_the_poses(make_node, capture, drive):
    odometries = []
    for exact in (True, False):
        node = make_node(SlamNode, exact_map=exact)
        published = capture(node)
        predictions_first(drive, node)
        odometries.append(published[ODOMETRY])
    assert odometries[0] == odometries[1]


@pytest.mark.parametrize("estimator", ["joint", "mapping"])
def test_each_estimator_publishes_the_best_map_it_has(make_node, capture, drive, estimator):
    node = make_node(SlamNode, estimator=estimator)
    published = capture(node)
    predictions_first(drive, node)
    node.publish_landmarks()
    landmarks = conversions.landmarks_from_message(published[LANDMARKS][-1])
    np.testing.assert_array_equal(landmarks.ids, node.core.landmarks().ids)
    assert not published[GYRO_BIAS]
    values = conversions.status_values(published[STEPS][-1], "slam_step")
    assert "gyro_bias_x" not in row_from_values(values)[0]


def test_the_bias_of_the_gyroscope_is_published_with_each_step(node, capture, drive):
    published = capture(node)
    predictions_first(drive, node)
    steps = offline(drive)
    assert len(published[GYRO_BIAS]) == len(steps)
    for message, told, step in zip(published[GYRO_BIAS], published[STEPS], steps, strict=True):
        assert decoding.stamp_of(message.header) == step.stamp
        assert message.header.frame_id == "base_link"
        vector = message.vector
        row, _, _ = row_from_values(conversions.status_values(told, "slam_step"))
        for axis in "xyz":
            name = f"gyro_bias_{axis}"
            assert getattr(vector, axis) == step.row()[name] == row[name]


@pytest.mark.parametrize("estimator", ["robocentric", "joint", "dead_reckoning"])
def test_odometry_tells_the_twist_in_the_body_s_axes_and_how_well_it_is_known(
    make_node, capture, drive, estimator
):
    node = make_node(SlamNode, estimator=estimator)
    published = capture(node)
    predictions_first(drive, node)
    last = published[ODOMETRY][-1].twist
    truth = drive.twists[-1].twist.twist
    assert last.twist.linear.x == pytest.approx(truth.linear.x, abs=0.2)
    assert last.twist.angular.z == pytest.approx(truth.angular.z, abs=0.02)
    for message in published[ODOMETRY]:
        variances = np.linalg.eigvalsh(message.twist.covariance.reshape(6, 6))
        assert np.all(variances > 0)
    # Who stands at the start does not know how fast it goes.
    assert published[ODOMETRY][0].twist.covariance[0] >= 50.0**2
    assert last.covariance[0] < 1.0


def test_map_to_odom_carries_the_prediction_into_the_map(drive):
    for prediction, step in zip(drive.predictions, offline(drive), strict=True):
        T_odom_body = se3.pose_matrix(*decoding.pose(prediction)[1:])
        T_map_body = se3.pose_matrix(step.position, step.quaternion)
        np.testing.assert_allclose(step.T_map_odom @ T_odom_body, T_map_body, atol=1e-12)


def test_what_is_published_may_change_at_run_time_but_not_the_frames(node):
    assert node.set_parameters([Parameter("path_length", value=3)])[0].successful
    assert node._path.maxlen == 3
    assert not node.set_parameters([Parameter("map_frame", value="m")])[0].successful


def test_localization_takes_its_map_from_a_file(make_node, capture, drive, tmp_path, node):
    predictions_first(drive, node)
    write_landmarks(tmp_path / "landmarks.npz", node.core.landmarks())
    localizing = make_node(
        SlamNode, estimator="localization", map_file=str(tmp_path / "landmarks.npz")
    )
    published = capture(localizing)
    predictions_first(drive, localizing)
    assert len(published[ODOMETRY]) == len(drive.stamps)


def test_localization_without_a_readable_map_does_not_start(make_node, tmp_path):
    with pytest.raises(VislamError, match="map_file"):
        make_node(SlamNode, estimator="localization")
    with pytest.raises(VislamError, match=r"none\.npz"):
        make_node(SlamNode, estimator="localization", map_file=str(tmp_path / "none.npz"))


def test_diagnostics_warn_of_observations_that_there_was_no_room_for(make_node, capture, drive):
    node = make_node(SlamNode, max_active=5)
    published = capture(node)
    predictions_first(drive, node)
    for _ in range(2):
        node.monitor.report()
    (warned,), (after,) = (message.status for message in published[DIAGNOSTICS][-2:])
    assert (warned.level, after.level) == (b"\x01", b"\x00")
    assert "observations left out by max_active" in warned.message


def test_diagnostics_tell_what_is_missing_and_what_was_done(node, capture, drive):
    published = capture(node)
    node.monitor.report()
    assert "waiting for calibration" in published[DIAGNOSTICS][-1].status[0].message
    predictions_first(drive, node)
    send(node, layout.FEATURES, drive.features[-1])
    node.monitor.report()
    message = published[DIAGNOSTICS][-1]
    values = conversions.status_values(message, "/slam_node")
    assert message.status[0].level == b"\x01"
    assert values["steps"] == str(len(drive.stamps))
    assert values["refused features_duplicate"] == "1"
    assert values["first features_duplicate [s]"] == stamp_text(drive.stamps[-1])
    assert values["received stereo/features"] == "1"
    assert int(values["total landmarks"]) > 0
    assert float(values["peak memory [MB]"]) > 0
    assert 0 <= float(values["rejected [%]"]) <= 100
    for key in ("stamp age [s]", "active landmarks", "NIS per degree of freedom"):
        assert key in values
