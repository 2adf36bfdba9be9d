# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import copy
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Imu

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    DIAGNOSTICS,
    IMU,
    PREDICTION,
    TRANSFORMS,
    TWIST,
)
from vislam_ros.nodes import conversions
from vislam_ros.nodes.imu_prediction_node import ImuPredictionNode
from vislam_ros.nodes.topics import message_class

WAIT = 30.0
TOPIC = PREDICTION.recorded


def twist_message(stamp, twist):
    message = TwistWithCovarianceStamped(header=conversions.header(stamp, "base_link"))
    v, w = message.twist.twist.linear, message.twist.twist.angular
    v.x, v.y, v.z, w.x, w.y, w.z = map(float, twist)
    return message


def imu_message(stamp, omega):
    message = Imu(header=conversions.header(stamp, "base_link"))
    v = message.angular_velocity
    v.x, v.y, v.z = map(float, omega)
    return message


@pytest.fixture
def node(make_node):
    return make_node(ImuPredictionNode)


def test_each_twist_gives_the_core_s_pose_bit_for_bit(node, capture, drive):
    published = capture(node)
    core = DeadReckoning(PredictionSettings())
    for message in drive.twists:
        node.on_twist(message)
    predictions = [
        expected
        for message in drive.twists
        for expected in core.add_twist(*decoding.twist(message, DEFAULT_FRAMES))
    ]
    assert len(predictions) == len(drive.twists)
    for expected, odometry in zip(predictions, published[TOPIC], strict=True):
        stamp, position, quaternion = decoding.pose(odometry)
        assert stamp == expected.stamp
        assert position.tobytes() == expected.position.tobytes()
        assert quaternion.tobytes() == expected.quaternion.tobytes()
        assert odometry.header.frame_id == "odom"
        assert odometry.child_frame_id == "base_link"


def test_covariance_is_about_fixed_axes_and_the_twist_s_in_the_child_frame(node, capture, drive):
    published = capture(node)
    for message in drive.twists:
        node.on_twist(message)
    core = DeadReckoning(PredictionSettings())
    for message in drive.twists:
        predictions = core.add_twist(*decoding.twist(message, DEFAULT_FRAMES))
    expected = predictions[-1]
    odometry = published[TOPIC][-1]
    R = se3.rotation_from_quaternion(expected.quaternion)
    blocks = np.kron(np.eye(2), R)
    np.testing.assert_allclose(
        np.reshape(odometry.pose.covariance, (6, 6)),
        blocks @ expected.covariance @ blocks.T,
        rtol=1e-12,
        atol=1e-18,
    )
    np.testing.assert_array_equal(
        np.reshape(odometry.twist.covariance, (6, 6)), expected.twist_covariance
    )
    assert odometry.twist.twist.linear.x == 2.0
    assert odometry.twist.twist.angular.z == 0.02


def test_refused_twists_are_counted_and_the_next_one_goes_on(node, capture, drive):
    published = capture(node)
    not_finite = copy.deepcopy(drive.twists[3])
    not_finite.twist.twist.linear.y = float("nan")
    elsewhere = copy.deepcopy(drive.twists[3])
    elsewhere.header.frame_id = "camera"
    for message in (
        drive.twists[0],
        drive.twists[2],
        drive.twists[2],
        drive.twists[1],
        not_finite,
        elsewhere,
        drive.twists[3],
    ):
        node.monitor.take(TWIST, serialize_message(message))
    assert len(published[TOPIC]) == 3
    assert node.monitor.refused.counts == {
        "twist_duplicate": 1,
        "twist_late": 1,
        "twist_non_finite": 1,
        "twist_unknown_frame": 1,
    }


def test_time_that_jumps_back_begins_at_the_identity(node, capture, drive):
    published = capture(node)
    for message in (*drive.twists, *drive.twists):
        node.on_twist(message)
    first, second = np.split(np.array(published[TOPIC]), 2)
    assert list(first) == list(second)
    assert not node.monitor.refused.counts


def test_angular_velocity_of_the_imu_replaces_the_twist_s(make_node, capture, drive):
    node = make_node(ImuPredictionNode, angular_velocity_source="imu")
    published = capture(node)
    omega = (0.0, 0.0, 0.5)
    first, second, third = drive.twists[:3]
    node.on_twist(first)
    assert not published[TOPIC]
    node.on_imu(imu_message(drive.stamps[0], omega))
    node.on_imu(imu_message(drive.stamps[1], omega))
    node.on_twist(second)
    node.on_twist(third)
    assert [o.twist.twist.angular.z for o in published[TOPIC]] == [0.5, 0.5]
    assert [o.twist.twist.linear.x for o in published[TOPIC]] == [2.0, 2.0]
    assert not node.monitor.refused.counts
    node.on_twist(drive.twists[4])
    node.on_imu(imu_message(drive.stamps[4], omega))
    assert node.monitor.refused.counts == {"twist_unpaired": 1}
    assert node.monitor.refused.first_stamps == {"twist_unpaired": drive.stamps[2]}


def status_of(node, published):
    node.monitor.report()
    (status,) = published[DIAGNOSTICS.name][-1].status
    return status.level, status.message


def test_an_imu_without_the_stamps_of_the_twists_is_a_warning(make_node, capture, drive):
    node = make_node(ImuPredictionNode, angular_velocity_source="imu")
    published = capture(node)
    assert status_of(node, published) == (DiagnosticStatus.OK, "waiting for imu/twist or imu/data")
    for message in drive.twists[:3]:
        node.on_twist(message)
    awaited = "waiting for imu/data with the stamps of imu/twist"
    assert status_of(node, published) == (DiagnosticStatus.OK, awaited)
    for stamp in drive.stamps[:3]:
        node.on_imu(imu_message(stamp + 1_000_000, (0.0, 0.0, 0.5)))
    level, message = status_of(node, published)
    assert level == DiagnosticStatus.WARN
    told = "angular_velocity_source: imu, and no imu/data has the stamp of a twist"
    assert message == f"{awaited}; {told}"
    for k in (3, 4):
        node.on_twist(drive.twists[k])
        node.on_imu(imu_message(drive.stamps[k], (0.0, 0.0, 0.5)))
    status_of(node, published)  # of those without a partner
    assert status_of(node, published) == (DiagnosticStatus.OK, "running")


def test_an_imu_message_without_angular_velocity_is_refused(make_node, drive):
    node = make_node(ImuPredictionNode, angular_velocity_source="imu")
    message = imu_message(drive.stamps[0], (0.0, 0.0, 0.0))
    message.angular_velocity_covariance[0] = -1.0
    node.monitor.take(IMU, serialize_message(message))
    assert node.monitor.refused.counts == {"imu_absent_field": 1}


def test_frames_are_parameters(make_node, capture, drive):
    node = make_node(ImuPredictionNode, odom_frame="o", base_frame="b")
    published = capture(node)
    for message in drive.twists[:2]:
        message.header.frame_id = "b"
        node.on_twist(message)
    odometry = published[TOPIC][0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("o", "b")


def hear_transforms(node):
    """Subscribe to what a node publishes on /tf, and wait until it knows."""
    (publisher,) = (one for one in node.publishers if one.topic_name == TRANSFORMS.name)
    message_type = message_class(TRANSFORMS.msgtype)
    node.create_subscription(message_type, TRANSFORMS.name, lambda _: None, 1, raw=True)
    deadline = time.monotonic() + WAIT
    while not publisher.get_subscription_count():
        assert time.monotonic() < deadline, "the subscription was not found"


def test_tf_says_the_same_as_the_odometry(node, capture, drive):
    published = capture(node)
    hear_transforms(node)
    for message in drive.twists[:3]:
        node.on_twist(message)
    odometry, data = published[TOPIC][-1], published[TRANSFORMS.name][-1]
    store = get_typestore(Stores.ROS2_JAZZY)
    (transform,) = store.deserialize_cdr(data, TRANSFORMS.msgtype).transforms
    assert transform.header.stamp.nanosec == odometry.header.stamp.nanosec
    assert transform.header.frame_id == odometry.header.frame_id == "odom"
    assert transform.child_frame_id == odometry.child_frame_id == "base_link"
    assert transform.transform.translation.x == odometry.pose.pose.position.x
    assert transform.transform.rotation.z == odometry.pose.pose.orientation.z


def test_no_transform_is_made_while_nobody_hears_it(node, capture, drive):
    published = capture(node)
    for message in drive.twists[:3]:
        node.on_twist(message)
    assert set(published) == {TOPIC}
    hear_transforms(node)
    node.on_twist(drive.twists[3])
    assert len(published[TRANSFORMS.name]) == 1


def test_the_gyroscope_alone_gives_the_core_s_poses_and_says_that_it_knows_no_velocity(
    make_node, capture
):
    node = make_node(ImuPredictionNode, motion_source="gyro")
    published, core = capture(node), DeadReckoning(PredictionSettings())
    expected = []
    for k in range(40):
        stamp, omega = k * 5_000_000, np.array([0.1, -0.2, 0.01 * k])
        node.on_imu(imu_message(stamp, omega))
        expected += core.add_angular_velocity(stamp, omega)
    assert len(published[TOPIC]) == len(expected) > 30
    for prediction, odometry in zip(expected, published[TOPIC], strict=True):
        stamp, _, quaternion, velocity_known = decoding.prediction(odometry, DEFAULT_FRAMES)
        assert stamp == prediction.stamp
        assert quaternion.tobytes() == prediction.quaternion.tobytes()
        assert not velocity_known
        assert odometry.twist.covariance[0] == 2500.0


def test_a_standing_imu_is_levelled_as_the_core_does_it(make_node, capture):
    nodes = [make_node(ImuPredictionNode, motion_source=source) for source in ("gyro", "auto")]
    published, core = [capture(node)[TOPIC] for node in nodes], DeadReckoning(PredictionSettings())
    expected, force = [], np.array([1.0, -2.0, 9.55])
    for k in range(300):
        stamp, omega = k * 5_000_000, np.array([0.01, -0.02, 0.03])
        message = imu_message(stamp, omega)
        a = message.linear_acceleration
        a.x, a.y, a.z = force.tolist()
        for node in nodes:
            node.on_imu(message)
        expected += core.add_angular_velocity(stamp, omega, force)
    assert expected[0].quaternion[3] < 0.999
    for heard in published:
        found = [decoding.pose(odometry) for odometry in heard]
        assert [stamp for stamp, *_ in found] == [one.stamp for one in expected]
        assert [q.tobytes() for *_, q in found] == [one.quaternion.tobytes() for one in expected]


def test_accelerations_that_are_marked_absent_level_nothing(make_node, capture):
    node = make_node(ImuPredictionNode, motion_source="gyro")
    published = capture(node)
    for k in range(20):
        message = imu_message(k * 5_000_000, (0.0, 0.0, 0.0))
        message.linear_acceleration.x = 9.8
        message.linear_acceleration_covariance[0] = -1.0
        node.on_imu(message)
    assert len(published[TOPIC]) == 20
    assert published[TOPIC][0].pose.pose.orientation.w == 1.0


def test_a_gyroscope_without_twists_is_found_and_loses_no_sample(make_node, capture):
    found, told = (make_node(ImuPredictionNode, motion_source=s) for s in ("auto", "gyro"))
    published = [capture(node)[TOPIC] for node in (found, told)]
    for k in range(300):
        message = imu_message(k * 5_000_000, (0.0, 0.1, 0.3))
        found.on_imu(message)
        told.on_imu(message)
        if k == 199:
            assert not published[0]
    assert published[0] == published[1]
    assert len(published[0]) > 250


@pytest.mark.parametrize("lag", [0, 3])
@pytest.mark.parametrize("turns", ["twist", "imu"])
def test_twists_that_begin_late_take_over_from_the_gyroscope(make_node, capture, lag, turns):
    """Also where they come later than the gyroscope's samples of their stamps."""
    node = make_node(ImuPredictionNode, angular_velocity_source=turns)
    published = capture(node)[TOPIC]
    for k in range(300):
        node.on_imu(imu_message(k * 10_000_000, (0.0, 0.0, 0.1)))
        if k >= 200:
            node.on_twist(twist_message((k - lag) * 10_000_000, np.array([2.0, 0, 0, 0, 0, 0.1])))
    told = [decoding.prediction(odometry, DEFAULT_FRAMES) for odometry in published]
    stamps = [stamp for stamp, *_ in told]
    assert stamps == list(range(0, (300 - lag) * 10_000_000, 10_000_000))
    known = [velocity_known for *_, velocity_known in told]
    assert known == sorted(known)
    assert 90 <= sum(known) <= 100
    turned = 2 * np.arccos(told[-1][2][3])
    assert turned == pytest.approx(0.1 * stamps[-1] * 1e-9)
    assert node.monitor.refused.counts.keys() <= {"twist_late", "twist_unpaired", "imu_unpaired"}
    assert node.monitor.refused.counts.total() <= 2 * lag + 4


def test_a_twist_that_cannot_be_leaves_the_gyroscope_at_work(make_node, capture, drive):
    node = make_node(ImuPredictionNode)
    published = capture(node)[TOPIC]
    for k in range(300):
        node.on_imu(imu_message(k * 10_000_000, (0.0, 0.0, 0.1)))
        if k >= 200:
            bad = twist_message(k * 10_000_000, np.full(6, np.nan))
            node.monitor.take(TWIST, serialize_message(bad))
    assert len(published) == 300
    assert node.monitor.refused.counts == {"twist_non_finite": 100}


def test_where_there_are_twists_the_gyroscope_is_not_taken_as_well(make_node, capture, drive):
    node = make_node(ImuPredictionNode)
    published, core = capture(node), DeadReckoning(PredictionSettings())
    expected = []
    for stamp, message in zip(drive.stamps, drive.twists, strict=False):
        node.on_imu(imu_message(stamp, (0.0, 0.0, 1.0)))
        node.on_twist(message)
        expected += core.add_twist(*decoding.twist(message, DEFAULT_FRAMES))
    assert [o.twist.twist.linear.x for o in published[TOPIC]] == [p.twist[0] for p in expected]
