# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import array

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import DEFAULT_FRAMES
from vislam_ros.nodes import conversions


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 1_317_000_000_123_456_789])
def test_stamp_keeps_every_nanosecond(stamp):
    assert decoding.stamp_of(conversions.header(stamp, "map")) == stamp


def test_pose_is_the_same_to_the_last_bit_after_odometry():
    rng = np.random.default_rng(0)
    position = rng.normal(0, 1e3, 3)
    quaternion = rng.normal(0, 1, 4)
    quaternion /= np.linalg.norm(quaternion)
    message = conversions.odometry(7, "map", "base_link", position, quaternion, np.eye(6))
    stamp, position_back, quaternion_back = decoding.pose(message)
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
    ids = np.arange(50, dtype=np.uint32)
    pixels = rng.uniform(-10, 1000, (50, 4)).astype(np.float32)
    message = conversions.features_to_message(11, DEFAULT_FRAMES.camera, ids, pixels)
    stamp, ids_back, pixels_back, _ = decoding.features(message, DEFAULT_FRAMES)
    assert stamp == 11
    np.testing.assert_array_equal(ids_back, ids)
    np.testing.assert_array_equal(pixels_back, pixels)


def test_features_without_points_are_empty():
    message = conversions.features_to_message(
        0, DEFAULT_FRAMES.camera, np.empty(0, np.uint32), np.empty((0, 4), np.float32)
    )
    _, ids, pixels, _ = decoding.features(message, DEFAULT_FRAMES)
    assert ids.shape == (0,)
    assert pixels.shape == (0, 4)


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


def test_status_values_read_back_to_the_same_numbers():
    values = {"count": 3, "value": 0.1 + 0.2, "flag": True, "text": "a"}
    message = conversions.status_array(
        conversions.stamp_to_message(5), [conversions.status("x", values)]
    )
    back = conversions.status_values(message, "x")
    assert back == {"count": "3", "value": repr(0.1 + 0.2), "flag": "true", "text": "a"}
    with pytest.raises(RefusedMessage):
        conversions.status_values(message, "y")
