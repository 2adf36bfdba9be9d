# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a file's twists are the body's, or those of an IMU that its extrinsics misplace."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions, settle_conventions
from vislam_ros.data.datasets.twist_origin import (
    is_nearer,
    measure_twist_origin,
    misplaced_imu,
    moved_to_the_body,
)
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import (
    BASELINE,
    INTRINSICS,
    T_BODY_CAMERA,
    SimulationSettings,
    simulate,
)

CLEAN = {"velocity_noise_std": 0.03, "angular_velocity_noise_std": 0.003}
NOISY = {"velocity_noise_std": 0.5, "angular_velocity_noise_std": 0.05}
HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


def simulated(**noise: Any) -> Drive:
    bias = (-0.01, 0.01, -0.01)
    settings = SimulationSettings(steps=800, landmarks=3500, frozen_share=0.1, **noise)
    return simulate(dataclasses.replace(settings, gyro_bias=bias)).drive


@pytest.fixture(scope="module", params=[CLEAN, NOISY], ids=["clean", "noisy"])
def drive(request: pytest.FixtureRequest) -> Drive:
    return simulated(**request.param)


def measured_at(drive: Drive, place: NDArray[np.float64] | tuple[float, float, float]) -> Drive:
    """The same drive, its twists those of a place (3,) in the body."""
    return dataclasses.replace(drive, twists=moved_to_the_body(drive, -np.asarray(place)))


def test_an_imu_is_where_the_translation_was_turned_the_wrong_way_from() -> None:
    # What T_body_camera should have been, and what it is with R^T s in place of -R s.
    R, s = T_BODY_CAMERA[:3, :3], -T_BODY_CAMERA[:3, :3].T @ T_BODY_CAMERA[:3, 3]
    wrong = T_BODY_CAMERA.copy()
    wrong[:3, 3] = R.T @ s
    camera = StereoCamera.from_matrices(INTRINSICS, BASELINE, wrong)
    # The camera is where it is: seen from either origin its place differs by the IMU's.
    np.testing.assert_allclose(
        misplaced_imu(camera) + T_BODY_CAMERA[:3, 3], wrong[:3, 3], atol=1e-12
    )


@pytest.mark.parametrize("place", [(0, 0, 0), (-1.9, 1.4, -1.0), (0.8, 0.5, 0.9)])
def test_the_place_is_measured_within_a_few_of_its_standard_deviations(
    drive: Drive, place: tuple[float, float, float]
) -> None:
    found = measure_twist_origin(measured_at(drive, place))
    assert found.distance_squared(np.array(place, dtype=float)) < 3 * 16.3  # 999 in 1000
    assert np.sqrt(np.diag(found.covariance)[:2]).max() < 0.3


def test_twists_of_a_misplaced_imu_are_moved_to_the_body(drive: Drive) -> None:
    imu = misplaced_imu(drive.camera)
    given = measured_at(drive, imu)
    settled = settle_conventions(given, AS_FOUND)
    np.testing.assert_allclose(settled.twists, drive.twists, atol=1e-12)
    assert settled.findings[-1].name == "twist_origin"
    assert settled.notes[-1] == settled.findings[-1].note
    told = settle_conventions(given, Conventions("flu", "end", "imu"))
    np.testing.assert_allclose(told.twists, drive.twists, atol=1e-12)
    assert settle_conventions(given, Conventions("flu", "end", "body")) is given


def test_twists_of_the_body_are_left_alone(drive: Drive) -> None:
    np.testing.assert_array_equal(settle_conventions(drive, AS_FOUND).twists, drive.twists)


def test_the_place_turns_with_the_axes_of_the_extrinsics() -> None:
    drive = simulated(**CLEAN)
    frd = dataclasses.replace(
        drive, camera=StereoCamera.from_matrices(INTRINSICS, BASELINE, HALF_TURN @ T_BODY_CAMERA)
    )
    imu = HALF_TURN[:3, :3] @ misplaced_imu(frd.camera)
    settled = settle_conventions(measured_at(frd, imu), AS_FOUND)
    np.testing.assert_allclose(settled.twists, drive.twists, atol=1e-12)


def test_a_body_that_never_turns_tells_nothing_and_is_left_alone() -> None:
    drive = simulated(**CLEAN)
    straight = np.zeros((len(drive.twists), 6))
    straight[:, 0] = 8.0
    still = dataclasses.replace(drive, twists=straight)
    found = measure_twist_origin(still)
    assert not is_nearer(found, misplaced_imu(still.camera)) or np.any(found.covariance > 1)
    few = dataclasses.replace(
        drive,
        twist_stamps=drive.twist_stamps[:3],
        twists=drive.twists[:3],
        feature_stamps=drive.feature_stamps[:3],
        offsets=drive.offsets[:4],
    )
    assert measure_twist_origin(few) is None


def test_a_moved_twist_moves_the_same_rigid_body() -> None:
    drive = simulated(**CLEAN)
    imu = np.array([1.0, -2.0, 0.5])
    of_imu = measured_at(drive, imu).twists[7]
    T_body_imu = np.eye(4)
    T_body_imu[:3, 3] = imu
    through_imu = T_body_imu @ se3.exp(0.1 * of_imu) @ se3.inverse(T_body_imu)
    np.testing.assert_allclose(through_imu, se3.exp(0.1 * drive.twists[7]), atol=1e-12)
