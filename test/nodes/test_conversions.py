# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import array

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.nodes import conversions
from vislam_ros.nodes.conversions import MessageError


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 1_317_000_000_123_456_789, -1])
def test_stamp_keeps_every_nanosecond(stamp):
    assert conversions.stamp_from_message(conversions.stamp_to_message(stamp)) == stamp


def test_pose_is_the_same_to_the_last_bit_after_odometry():
    rng = np.random.default_rng(0)
    position = rng.normal(0, 1e3, 3)
    quaternion = rng.normal(0, 1, 4)
    quaternion /= np.linalg.norm(quaternion)
    message = conversions.odometry(7, "map", "base_link", position, quaternion, np.eye(6))
    stamp, position_back, quaternion_back = conversions.pose_from_odometry(message)
    assert stamp == 7
    assert position_back.tobytes() == position.tobytes()
    assert quaternion_back.tobytes() == quaternion.tobytes()


def test_odometry_covariance_is_of_position_then_rotation_about_fixed_axes():
    """Sampled: p and the fixed-axis rotation of T Exp(xi), against the message's matrix."""
    rng = np.random.default_rng(1)
    A = rng.normal(0, 1, (6, 6))
    Sigma = 1e-4 * (A @ A.T)
    T = se3.exp([3.0, -2.0, 1.0, 0.7, -0.4, 1.9])
    q = se3.quaternion_from_rotation(T[:3, :3])
    message = conversions.odometry(0, "map", "base_link", T[:3, 3], q, Sigma)
    told = np.reshape(message.pose.covariance, (6, 6))

    xi = rng.multivariate_normal(np.zeros(6), Sigma, size=200_000)
    samples = T @ se3.exp(xi)
    d_position = samples[:, :3, 3] - T[:3, 3]
    d_rotation = se3.log_rotation(samples[:, :3, :3] @ T[:3, :3].T)
    sampled = np.cov(np.hstack([d_position, d_rotation]).T)

    scale = np.sqrt(np.outer(np.diag(told), np.diag(told)))
    np.testing.assert_allclose(sampled / scale, told / scale, atol=0.02)
    np.testing.assert_allclose(
        conversions.covariance_from_odometry(message), Sigma, rtol=1e-12, atol=1e-18
    )


def test_features_round_trip_exactly():
    rng = np.random.default_rng(2)
    ids = rng.permutation(50).astype(np.uint32)
    pixels = rng.uniform(-10, 1000, (50, 4)).astype(np.float32)
    message = conversions.features_to_message(11, "camera", ids, pixels)
    stamp, ids_back, pixels_back = conversions.features_from_message(message)
    assert (stamp, message.header.frame_id) == (11, "camera")
    np.testing.assert_array_equal(ids_back, ids)
    np.testing.assert_array_equal(pixels_back, pixels)


def test_features_without_points_are_empty():
    message = conversions.features_to_message(
        0, "c", np.empty(0, np.uint32), np.empty((0, 4), np.float32)
    )
    _, ids, pixels = conversions.features_from_message(message)
    assert ids.shape == (0,)
    assert pixels.shape == (0, 4)


def test_features_are_read_by_field_name_at_any_offset():
    dtype = np.dtype(
        {
            "names": ["v_right", "u_left", "id", "v_left", "u_right"],
            "formats": ["<f4", "<f4", "<u4", "<f4", "<f4"],
            "offsets": [4, 8, 16, 24, 28],
            "itemsize": 40,
        }
    )
    points = np.zeros(2, dtype)
    points["id"], points["u_left"], points["v_right"] = (7, 9), (1.5, 2.5), (3.5, 4.5)
    message = PointCloud2(height=1, width=2, point_step=40, row_step=80)
    message.fields = [
        PointField(
            name=name,
            offset=dtype.fields[name][1],
            datatype=PointField.UINT32 if name == "id" else PointField.FLOAT32,
            count=1,
        )
        for name in dtype.names
    ]
    message.data = array.array("B", points.tobytes())
    _, ids, pixels = conversions.features_from_message(message)
    np.testing.assert_array_equal(ids, [7, 9])
    np.testing.assert_array_equal(pixels[:, 0], [1.5, 2.5])
    np.testing.assert_array_equal(pixels[:, 3], [3.5, 4.5])


def a_features_message() -> PointCloud2:
    return conversions.features_to_message(
        0, "c", np.arange(3, dtype=np.uint32), np.ones((3, 4), np.float32)
    )


def cut_data(message):
    message.data = message.data[:-1]


def too_many_points(message):
    message.width = 2**31


def no_point_size(message):
    message.point_step = 0


def offset_outside(message):
    message.fields = list(message.fields)
    message.fields[2] = PointField(name="v_left", offset=18, datatype=7, count=1)


def no_id(message):
    message.fields = message.fields[1:]


def wrong_type(message):
    message.fields = list(message.fields)
    message.fields[1] = PointField(name="u_left", offset=4, datatype=PointField.INT32, count=1)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (cut_data, "wrong_size"),
        (too_many_points, "wrong_size"),
        (no_point_size, "wrong_size"),
        (offset_outside, "wrong_size"),
        (no_id, "bad_fields"),
        (wrong_type, "bad_fields"),
    ],
)
def test_features_that_contradict_themselves_are_refused(spoil, reason):
    message = a_features_message()
    spoil(message)
    with pytest.raises(MessageError) as error:
        conversions.features_from_message(message)
    assert error.value.reason == reason


def test_landmarks_keep_single_precision_and_count_generations():
    rng = np.random.default_rng(3)
    A = rng.normal(0, 1, (4, 3, 3))
    landmarks = LandmarkMap(
        ids=np.array([5, 2, 5, 5], np.uint32),
        generations=np.array([0, 0, 1, 2], np.uint32),
        positions=rng.normal(0, 100, (4, 3)),
        covariances=A @ A.swapaxes(1, 2),
    )
    message = conversions.landmarks_to_message(3, "map", landmarks)
    assert isinstance(message.data, array.array)
    assert [field.name for field in message.fields] == (
        ["x", "y", "z", "id", "cxx", "cxy", "cxz", "cyy", "cyz", "czz"]
    )
    back = conversions.landmarks_from_message(message)
    np.testing.assert_array_equal(back.ids, landmarks.ids)
    np.testing.assert_array_equal(back.generations, landmarks.generations)
    np.testing.assert_array_equal(back.positions, landmarks.positions.astype(np.float32))
    np.testing.assert_allclose(back.covariances, landmarks.covariances, rtol=1e-6, atol=1e-6)


def test_camera_is_the_same_to_the_last_bit(drive):
    camera = conversions.camera_from_messages(drive.left, drive.right, drive.extrinsics)
    assert camera == drive.camera


def other_focal_length(drive):
    drive.right.p[0] += 1.0


def no_baseline(drive):
    drive.right.p[3] = 0.0


def uncalibrated(drive):
    drive.left.p[:] = 0.0
    drive.right.p[:] = 0.0


def not_finite(drive):
    drive.left.p[2] = np.nan


def no_rotation(drive):
    drive.extrinsics.transform.rotation.w = 5.0


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (other_focal_length, "bad_camera_info"),
        (no_baseline, "bad_camera_info"),
        (uncalibrated, "bad_camera_info"),
        (not_finite, "bad_camera_info"),
        (no_rotation, "bad_extrinsics"),
    ],
)
def test_a_pair_that_is_not_calibrated_is_refused(drive, spoil, reason):
    spoil(drive)
    with pytest.raises(MessageError) as error:
        conversions.camera_from_messages(drive.left, drive.right, drive.extrinsics)
    assert error.value.reason == reason


def test_status_values_read_back_to_the_same_numbers():
    values = {"count": 3, "value": 0.1 + 0.2, "flag": True, "text": "a"}
    message = conversions.status_array(
        conversions.stamp_to_message(5), [conversions.status("x", values)]
    )
    back = conversions.status_values(message, "x")
    assert back == {"count": "3", "value": repr(0.1 + 0.2), "flag": "true", "text": "a"}
    with pytest.raises(MessageError):
        conversions.status_values(message, "y")
