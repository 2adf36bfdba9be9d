# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA, difference, landmarks_ahead, random_pose
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.observation import StereoObservation

Array = NDArray[np.float64]

EQUAL = (1.0, 1.0, 1.0, 1.0)
UNEQUAL = (1.0, 2.0, 3.0, 4.0)


@pytest.fixture(params=[EQUAL, UNEQUAL], ids=["three rows", "four rows"])
def observation(request: pytest.FixtureRequest) -> StereoObservation:
    return StereoObservation(CAMERA, request.param)


@pytest.fixture
def scene() -> tuple[Array, Array]:
    rng = np.random.default_rng(7)
    T = random_pose(rng)
    return T, landmarks_ahead(rng, T, 12)


def test_equal_variances_need_three_rows_and_others_four() -> None:
    assert StereoObservation(CAMERA, EQUAL).noise.shape == (3, 3)
    assert StereoObservation(CAMERA, UNEQUAL).noise.shape == (4, 4)


def test_rows_of_left_and_right_differ_by_one_standard_deviation(
    observation: StereoObservation,
) -> None:
    variance = UNEQUAL if len(observation.noise) == 4 else EQUAL
    rng = np.random.default_rng(8)
    pixels = rng.uniform(0.0, 300.0, (20000, 4))
    pixels[:, 3] = pixels[:, 1]
    pixels += np.sqrt(variance) * rng.standard_normal(pixels.shape)
    assert_allclose(np.std(observation.row_mismatch(pixels)), 1.0, rtol=0.02)


def test_pose_jacobian_is_its_finite_difference(
    observation: StereoObservation, scene: tuple[Array, Array]
) -> None:
    T, landmarks = scene
    H = observation.predict(T, landmarks).H_pose

    def z_of(xi: Array) -> Array:
        return observation.predict(T @ se3.exp(xi), landmarks).z

    assert_allclose(H, difference(z_of, np.zeros(6)), rtol=1e-5, atol=1e-4)


def test_pose_jacobian_is_the_reports_equation_58(scene: tuple[Array, Array]) -> None:
    T, landmarks = scene
    H = StereoObservation(CAMERA, UNEQUAL).predict(T, landmarks).H_pose
    M = np.array(
        [
            [CAMERA.fx, 0, CAMERA.cx, 0],
            [0, CAMERA.fy, CAMERA.cy, 0],
            [CAMERA.fx, 0, CAMERA.cx, -CAMERA.fx_baseline],
            [0, CAMERA.fy, CAMERA.cy, 0],
        ]
    )
    for m, H_i in zip(landmarks, H, strict=True):
        body = se3.inverse(T) @ np.append(m, 1.0)
        q = CAMERA.T_camera_body @ body
        dpi = np.eye(4) / q[2] - np.outer(q, [0, 0, 1, 0]) / q[2] ** 2
        assert_allclose(H_i, -M @ dpi @ CAMERA.T_camera_body @ se3.odot(body), atol=1e-9)


def test_landmark_jacobian_is_its_finite_difference(
    observation: StereoObservation, scene: tuple[Array, Array]
) -> None:
    T, landmarks = scene
    H = observation.predict(T, landmarks).H_landmark
    for m, H_i in zip(landmarks, H, strict=True):
        numeric = difference(lambda p: observation.predict(T, p[None]).z[0], m, 1e-5)
        assert_allclose(H_i, numeric, rtol=1e-5, atol=1e-4)


def test_a_landmark_behind_the_camera_is_not_visible_and_gives_no_infinities(
    observation: StereoObservation,
) -> None:
    T = np.eye(4)
    predicted = observation.predict(T, np.array([[-5.0, 0, 0], [30.0, 1, 1]]))
    assert predicted.visible.tolist() == [False, True]
    assert np.all(np.isfinite(predicted.z))
    assert not predicted.H_pose[0].any()


def test_inversion_undoes_prediction(
    observation: StereoObservation, scene: tuple[Array, Array]
) -> None:
    T, landmarks = scene
    y = CAMERA.project(
        (landmarks - T[:3, 3]) @ T[:3, :3] @ CAMERA.T_camera_body[:3, :3].T
        + CAMERA.T_camera_body[:3, 3]
    )
    pixels = y[:, [0, 2, 1, 2]]
    positions, J_pose, noise = observation.invert(T, pixels)
    assert_allclose(positions, landmarks, rtol=1e-9)

    def position_of(xi: Array) -> Array:
        return observation.invert(T @ se3.exp(xi), pixels)[0]

    assert_allclose(J_pose, difference(position_of, np.zeros(6)), rtol=1e-5, atol=1e-5)
    for i, pixel in enumerate(pixels):
        J = difference(lambda z: observation.invert(T, z[None])[0][0], pixel, 1e-5)
        V = np.diag(UNEQUAL if len(observation.noise) == 4 else EQUAL)
        # The weighted image point is linear in the pixels, so J V J^T is the noise.
        assert_allclose(noise[i], J @ V @ J.T, rtol=1e-4, atol=1e-9)


def test_three_rows_hold_the_same_information_as_four(scene: tuple[Array, Array]) -> None:
    T, landmarks = scene
    three = StereoObservation(CAMERA, EQUAL)
    four = StereoObservation(CAMERA, (1.0, 1.0, 1.0, 1.0 + 1e-13))
    assert three.noise.shape != four.noise.shape
    for field in ("H_pose", "H_landmark"):
        H3 = getattr(three.predict(T, landmarks), field)
        H4 = getattr(four.predict(T, landmarks), field)
        information3 = np.swapaxes(H3, 1, 2) @ np.linalg.inv(three.noise) @ H3
        information4 = np.swapaxes(H4, 1, 2) @ np.linalg.inv(four.noise) @ H4
        assert_allclose(information3, information4, rtol=1e-9, atol=1e-9)
