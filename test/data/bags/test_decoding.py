# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands in a message, of whatever layout, and what makes one refused."""

from types import SimpleNamespace

import numpy as np
import pytest
from rewriting import STORE

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    EXTRINSICS,
    FEATURES,
    GROUND_TRUTH,
    IMU,
    RIGHT_CAMERA,
    TWIST,
    Frames,
)

FIELD = STORE.types["sensor_msgs/msg/PointField"]
DECODERS = {
    TWIST: lambda message: decoding.twist(message, DEFAULT_FRAMES),
    IMU: lambda message: decoding.angular_velocity(message, DEFAULT_FRAMES),
    FEATURES: lambda message: decoding.features(message, DEFAULT_FRAMES),
    EXTRINSICS: lambda message: decoding.extrinsics(message, DEFAULT_FRAMES),
    GROUND_TRUTH: decoding.true_pose,
    RIGHT_CAMERA: decoding.projection,
}


@pytest.fixture
def first(bag):
    """Decoded by its type, the first message of a topic."""

    def first(topic):
        with BagMessages(bag) as messages:
            _, _, data = next(iter(messages.messages([topic.recorded])))
        message = STORE.deserialize_cdr(data, topic.msgtype)
        for name in ("p", "data", "angular_velocity_covariance"):
            if hasattr(message, name):
                setattr(message, name, getattr(message, name).copy())  # to be written to
        return message

    return first


def test_a_twist_is_linear_then_angular(first, small_drive):
    stamp, twist = DECODERS[TWIST](first(TWIST))
    assert stamp == small_drive.twist_stamps[0]
    assert twist.tobytes() == small_drive.twists[0].tobytes()


def test_an_angular_velocity_is_the_twists(first, small_drive):
    stamp, omega = DECODERS[IMU](first(IMU))
    assert stamp == small_drive.twist_stamps[0]
    assert omega.tobytes() == small_drive.twists[0, 3:].tobytes()


def test_a_pose_is_position_and_quaternion_x_y_z_w(first, small_drive):
    stamp, position, quaternion = decoding.pose(first(GROUND_TRUTH))
    assert stamp == small_drive.ground_truth.stamps[0]
    assert position.tobytes() == small_drive.ground_truth.positions[0].tobytes()
    assert quaternion.tobytes() == small_drive.ground_truth.quaternions[0].tobytes()


def test_a_pose_that_cannot_be_is_written_down_all_the_same(first):
    message = first(GROUND_TRUTH)
    message.pose.pose.position.x = float("nan")
    assert np.isnan(decoding.pose(message)[1][0])


def test_a_prediction_speaks_of_the_odometry_frame_and_the_body(first):
    message = first(GROUND_TRUTH)
    frames = Frames(odom=message.header.frame_id, base=message.child_frame_id)
    assert decoding.prediction(message, frames)[0] == decoding.pose(message)[0]
    for frames, parameter in (
        (Frames(odom="start", base=message.child_frame_id), "odom_frame"),
        (Frames(odom=message.header.frame_id, base="car"), "base_frame"),
    ):
        with pytest.raises(RefusedMessage, match=f"set the parameter {parameter} to it"):
            decoding.prediction(message, frames)


def test_a_cloud_of_any_layout_is_read(first, small_drive):
    """Doubles, other order and offsets, big endian, further fields, padded rows."""
    dtype = np.dtype(
        {
            "names": ["v_right", "quality", "u_right", "v_left", "id", "u_left"],
            "formats": [">f8", "u1", ">f4", ">f8", ">u2", ">f4"],
            "offsets": [8, 0, 20, 24, 2, 40],
            "itemsize": 50,
        }
    )
    codes = {"f8": 8, "u1": 2, "f4": 7, "u2": 4}
    cloud = first(FEATURES)
    for k in range(small_drive.steps):
        ids, pixels = small_drive.frame(k)
        points = np.zeros(len(ids), dtype=dtype)
        points["id"] = ids
        points["u_left"], points["v_left"], points["u_right"], points["v_right"] = pixels.T
        padded = np.zeros((len(ids), 53), dtype=np.uint8)
        padded[:, :50] = points.view(np.uint8).reshape(-1, 50)
        cloud.fields = [
            FIELD(name=name, offset=offset, datatype=codes[kind.str[1:]], count=1)
            for name, (kind, offset) in dtype.fields.items()
        ]
        cloud.height, cloud.width = len(ids), 1
        if len(ids) == 1:
            padded = padded[:, :50]
        cloud.point_step, cloud.row_step, cloud.is_bigendian = 50, 53, True
        cloud.data = padded.ravel()
        _, ids_back, pixels_back, noise = DECODERS[FEATURES](cloud)
        assert noise is None
        np.testing.assert_array_equal(ids_back, ids)
        np.testing.assert_array_equal(pixels_back, pixels)
        assert (ids_back.dtype, pixels_back.dtype) == (np.uint32, np.float32)


def test_features_are_sorted_by_id(first):
    cloud = first(FEATURES)
    _, ids, pixels, _ = DECODERS[FEATURES](cloud)
    cloud.data = cloud.data.reshape(-1, 20)[::-1].ravel()
    _, ids_back, pixels_back, _ = DECODERS[FEATURES](cloud)
    np.testing.assert_array_equal(ids_back, ids)
    np.testing.assert_array_equal(pixels_back, pixels)


def repeat_point(cloud):
    cloud.data = np.concatenate([cloud.data, cloud.data[:20]])
    cloud.width += 1


def spoil_pixel(cloud):
    cloud.data[4:8] = 255


def drop_field(name):
    def drop(cloud):
        cloud.fields = [field for field in cloud.fields if field.name != name]

    return drop


def retype(name, datatype):
    def retype(cloud):
        next(field for field in cloud.fields if field.name == name).datatype = datatype

    return retype


def put(path, value):
    """A change of an attribute, such as ``header.stamp.sec``, or of an element of it."""

    def change(message):
        *parents, last = path.split(".")
        for name in parents:
            message = getattr(message, name)
        if last.isdigit():
            message[int(last)] = value
        else:
            setattr(message, last, value)

    return change


def empty_of_huge_points(cloud):
    """No features, of 2 GiB each."""
    cloud.width, cloud.point_step, cloud.row_step, cloud.data = 0, 2**31, 0, cloud.data[:0]


NAN = float("nan")


@pytest.mark.parametrize(
    ("topic", "change", "refusal", "words"),
    [
        (TWIST, put("twist.twist.linear.y", NAN), Refusal.NON_FINITE, "not finite"),
        (TWIST, put("twist.twist.angular.z", np.inf), Refusal.NON_FINITE, "not finite"),
        (TWIST, put("header.stamp.sec", -5), Refusal.BEFORE_1970, "header.stamp.sec is -5"),
        (TWIST, put("header.frame_id", "imu"), Refusal.UNKNOWN_FRAME, "'imu', not 'base_link'"),
        (IMU, put("angular_velocity.x", NAN), Refusal.NON_FINITE, "not finite"),
        (
            IMU,
            put("angular_velocity_covariance.0", -1.0),
            Refusal.ABSENT_FIELD,
            "angular velocity",
        ),
        (IMU, put("header.frame_id", "imu"), Refusal.UNKNOWN_FRAME, "parameter base_frame"),
        (FEATURES, put("header.frame_id", "cam"), Refusal.UNKNOWN_FRAME, "parameter camera_frame"),
        (FEATURES, put("header.stamp.sec", -5), Refusal.BEFORE_1970, "header.stamp.sec is -5"),
        (FEATURES, put("width", 2**31), Refusal.WRONG_SIZE, "data has another length"),
        (FEATURES, put("point_step", 12), Refusal.WRONG_SIZE, "field reaches beyond the point"),
        (FEATURES, put("point_step", 0), Refusal.WRONG_SIZE, "field reaches beyond the point"),
        (FEATURES, empty_of_huge_points, Refusal.WRONG_SIZE, "a point of 2147483648 bytes"),
        (FEATURES, spoil_pixel, Refusal.NON_FINITE, "not finite"),
        (FEATURES, repeat_point, Refusal.DUPLICATE_IDS, "an id appears twice"),
        (FEATURES, retype("id", 7), Refusal.BAD_FIELDS, "'id' has datatype 7"),
        (FEATURES, retype("u_left", 5), Refusal.BAD_FIELDS, "'u_left' has datatype 5"),
        (FEATURES, retype("v_right", 99), Refusal.BAD_FIELDS, "'v_right' has datatype 99"),
        *(
            (FEATURES, drop_field(name), Refusal.BAD_FIELDS, f"no field '{name}'")
            for name in ("id", "u_left", "v_left", "u_right", "v_right")
        ),
        (GROUND_TRUTH, put("pose.pose.orientation.w", 7.0), Refusal.NOT_A_ROTATION, "length 1"),
        (EXTRINSICS, put("transform.rotation.w", 7.0), Refusal.NOT_A_ROTATION, "length 1"),
        (EXTRINSICS, put("transform.translation.z", NAN), Refusal.NON_FINITE, "not finite"),
        (EXTRINSICS, put("header.frame_id", "car"), Refusal.UNKNOWN_FRAME, "parameter base_frame"),
        (EXTRINSICS, put("child_frame_id", "cam"), Refusal.UNKNOWN_FRAME, "r camera_frame"),
        (RIGHT_CAMERA, put("p.0", 0.0), Refusal.NOT_A_PAIR, "no positive focal length"),
        (RIGHT_CAMERA, put("p.5", NAN), Refusal.NON_FINITE, "not finite"),
        (TWIST, put("twist.twist.linear.y", 1e30), Refusal.ABSURD, "from -1000 to 1000"),
        (IMU, put("angular_velocity.x", -1e200), Refusal.ABSURD, "from -1000 to 1000"),
        (EXTRINSICS, put("transform.translation.z", 1e9), Refusal.ABSURD, "from -1000 to 1000"),
        (RIGHT_CAMERA, put("p.0", 1e300), Refusal.ABSURD, "from 1 to 1e+06"),
        (RIGHT_CAMERA, put("p.6", 1e300), Refusal.ABSURD, "from -1e+06 to 1e+06"),
    ],
)
def test_a_bad_message_is_refused_with_its_reason(first, topic, change, refusal, words):
    message = first(topic)
    DECODERS[topic](message)
    change(message)
    with pytest.raises(RefusedMessage) as error:
        DECODERS[topic](message)
    assert error.value.refusal is refusal
    assert words in str(error.value)


def test_a_negative_id_does_not_fit(first):
    cloud = first(FEATURES)
    cloud.data[:4] = 255
    retype("id", 5)(cloud)
    with pytest.raises(RefusedMessage, match="does not fit into 32 bits"):
        DECODERS[FEATURES](cloud)


def test_a_stamp_is_known_where_there_is_one_that_can_be(first):
    message = first(TWIST)
    assert decoding.stamp_if_known(message) == decoding.stamp_of(message.header)
    put("header.stamp.sec", -1)(message)
    assert decoding.stamp_if_known(message) is None
    assert decoding.stamp_if_known(None) is None
    assert decoding.stamp_if_known(SimpleNamespace()) is None
