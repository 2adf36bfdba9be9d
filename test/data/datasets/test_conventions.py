# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The axes and the step of the twists are found in the images and brought to one convention."""

import dataclasses

import numpy as np
import pytest

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import (
    AS_FOUND,
    Conventions,
    extrinsics_frame,
    in_radians,
    is_in_degrees,
    reprojection_errors,
    settle_conventions,
)
from vislam_ros.data.datasets.mending import inverted
from vislam_ros.data.datasets.step_pairs import step_pairs
from vislam_ros.data.datasets.twist_origin import misplaced_imu
from vislam_ros.data.simulation.simulate import (
    BASELINE,
    INTRINSICS,
    T_BODY_CAMERA,
    SimulationSettings,
    simulate,
)
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

AS_GIVEN = Conventions("as-given", "end", "body")
HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
TURNED = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def drive():
    """A simulated drive, which is in the package's convention."""
    return simulate(
        SimulationSettings(
            steps=150,
            landmarks=600,
            pixel_noise_std=0.3,
            velocity_noise_std=0.02,
            angular_velocity_noise_std=0.002,
            frozen_share=0.15,
        )
    ).drive


def with_frd_extrinsics(drive):
    camera = StereoCamera.from_matrices(INTRINSICS, BASELINE, HALF_TURN @ T_BODY_CAMERA)
    return dataclasses.replace(drive, camera=camera)


def with_frd_twists(drive):
    truth = drive.ground_truth
    return dataclasses.replace(
        drive,
        twists=drive.twists * TURNED,
        ground_truth=Trajectory.from_matrices(
            truth.stamps, HALF_TURN @ truth.T_world_body @ HALF_TURN
        ),
    )


def with_twists_at_the_start(drive):
    return dataclasses.replace(drive, twists=np.concatenate([drive.twists[1:], drive.twists[-1:]]))


def assert_settled(settled, drive):
    """Equal but for the first twist, which carries no step."""
    np.testing.assert_array_equal(settled.twists[1:], drive.twists[1:])
    np.testing.assert_allclose(
        settled.camera.T_body_camera, drive.camera.T_body_camera, atol=1e-15
    )
    np.testing.assert_allclose(
        settled.ground_truth.T_world_body, drive.ground_truth.T_world_body, atol=1e-12
    )


AXES = {"flu": "forward-left-up", "frd": "forward-right-down"}


def unchanged(drive):
    return drive


@pytest.mark.parametrize("at_start", [unchanged, with_twists_at_the_start])
@pytest.mark.parametrize("twists", [unchanged, with_frd_twists])
@pytest.mark.parametrize("extrinsics", [unchanged, with_frd_extrinsics])
def test_every_mixture_is_found_and_mended(drive, extrinsics, twists, at_start):
    given = at_start(twists(extrinsics(drive)))
    settled = settle_conventions(given, AS_FOUND)
    assert_settled(settled, drive)

    frame = "flu" if twists is unchanged else "frd"
    index = "end" if at_start is unchanged else "start"
    told = settle_conventions(given, Conventions(frame, index))
    assert_settled(told, drive)
    assert settled.notes == told.notes
    for finding in settled.findings:
        errors = finding.numbers["reprojection_px"]
        assert len(errors) == 4
        assert errors[f"{AXES[frame]} at the {index} of their step"] == min(errors.values())
    assert [each.name for each in settled.findings] == [
        *["twist_index"] * (at_start is not unchanged),
        *["imu_frame"] * ((twists is unchanged) != (extrinsics is unchanged)),
    ]
    assert (told.notes == ()) == (extrinsics is twists is at_start is unchanged)


@pytest.mark.parametrize("twists", [unchanged, with_frd_twists])
@pytest.mark.parametrize("extrinsics", [unchanged, with_frd_extrinsics])
def test_an_angular_velocity_in_degrees_is_named_and_its_axes_found(drive, extrinsics, twists):
    given = twists(extrinsics(drive))
    degrees = dataclasses.replace(given, twists=given.twists * np.repeat([1, np.rad2deg(1)], 3))
    settled = settle_conventions(degrees, AS_FOUND)
    assert settled.camera == settle_conventions(given, AS_FOUND).camera
    assert is_in_degrees(settled)
    finding = settled.findings[-1]
    assert (finding.name, finding.is_repaired) == ("contradiction", False)
    assert "57.3 times what the images tell, as if in degrees" in finding.words
    np.testing.assert_allclose(in_radians(settled).twists[1:], drive.twists[1:], rtol=1e-12)


@pytest.mark.parametrize("factor", [-1.0, 3.0])
def test_another_factor_is_not_named_degrees(drive, factor):
    other = dataclasses.replace(drive, twists=drive.twists * np.repeat([1, factor], 3))
    assert not is_in_degrees(settle_conventions(other, AS_FOUND))


def test_nothing_is_mended_on_top_of_extrinsics_that_are_contradicted(drive):
    given = dataclasses.replace(with_twists_at_the_start(drive), camera=inverted(drive.camera))
    assert settle_conventions(given, AS_FOUND) is given


def test_a_drive_in_the_convention_is_left_alone(drive):
    for imu_frame in ("auto", "flu", "as-given"):
        for twist_index in ("auto", "end"):
            settled = settle_conventions(drive, Conventions(imu_frame, twist_index))
            assert settled.camera == drive.camera
            np.testing.assert_array_equal(settled.twists, drive.twists)


def test_as_given_touches_neither_axes(drive):
    given = with_frd_extrinsics(with_twists_at_the_start(drive))
    settled = settle_conventions(given, AS_GIVEN)
    assert settled is given
    settled = settle_conventions(given, Conventions("as-given", "auto"))
    assert settled.camera == given.camera


def test_an_unknown_choice_is_refused():
    with pytest.raises(VislamError, match="imu_frame is 'ned': choose one of auto, flu"):
        Conventions(imu_frame="ned")
    with pytest.raises(VislamError, match="twist_index is 'middle'"):
        Conventions(twist_index="middle")
    with pytest.raises(VislamError, match="twist_origin is 'lidar'"):
        Conventions(twist_origin="lidar")


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_too_little_to_judge_is_taken_as_given(drive, frames):
    count = min(int(drive.offsets[frames]), 15)
    given = with_frd_extrinsics(
        dataclasses.replace(
            drive,
            twist_stamps=drive.twist_stamps[:frames],
            twists=drive.twists[:frames],
            feature_stamps=drive.feature_stamps[:frames],
            offsets=np.minimum(drive.offsets[: frames + 1], count),
            ids=drive.ids[:count],
            pixels=drive.pixels[:count],
        )
    )
    settled = settle_conventions(given, AS_FOUND)
    assert settled.camera == given.camera
    np.testing.assert_array_equal(settled.twists, given.twists)
    assert "Too few landmarks" in settled.notes[-1]


def test_turning_axes_loses_no_digit(drive):
    frd = with_frd_extrinsics(drive)
    once = settle_conventions(frd, Conventions("flu", "end")).camera
    assert extrinsics_frame(frd.camera) == "frd"
    assert extrinsics_frame(once) == "flu"
    assert sorted(np.abs(once.quaternion_body_camera)) == sorted(
        np.abs(frd.camera.quaternion_body_camera)
    )
    assert once.quaternion_body_camera[3] >= 0
    np.testing.assert_allclose(
        once.T_body_camera, HALF_TURN @ frd.camera.T_body_camera, atol=1e-15
    )


def test_without_noise_the_true_twists_reproject_exactly():
    simulated = simulate(
        SimulationSettings(
            steps=60,
            landmarks=300,
            pixel_noise_std=0.0,
            velocity_noise_std=0.0,
            angular_velocity_noise_std=0.0,
            gyro_bias=(0.0, 0.0, 0.0),
            outlier_share=0.0,
        )
    )
    pairs = step_pairs(simulated.drive)
    errors = reprojection_errors(simulated.drive, pairs)
    assert len(errors) == len(pairs.steps) > 500
    # Pixels are rounded to float32, and near points magnify that of their disparity.
    assert errors.max() < 1e-2


def test_frozen_steps_are_not_looked_at(drive):
    simulated_frozen = {
        k
        for k in range(1, drive.steps)
        if len(np.intersect1d(drive.frame(k - 1)[1][:, 0], drive.frame(k)[1][:, 0])) > 5
    }
    assert simulated_frozen
    assert not simulated_frozen & set((step_pairs(drive).steps + 1).tolist())


@pytest.mark.parametrize("name", ["03", "10_synthetic"])
def test_drives_with_mixed_axes_are_mended(shared_data, name):
    drive = npz.read(shared_data / f"{name}.npz")
    given = npz.read(shared_data / f"{name}.npz", conventions=AS_GIVEN)
    assert extrinsics_frame(given.camera) == "frd"
    assert extrinsics_frame(drive.camera) == "flu"
    np.testing.assert_array_equal(drive.twists, given.twists)
    assert "turned the extrinsics" in drive.notes[0]
    pairs = step_pairs(drive)
    before, after = (np.median(reprojection_errors(each, pairs)) for each in (given, drive))
    assert after < 0.6 * before


@pytest.mark.parametrize("name", ["0027", "0022", "0020"])
def test_kittis_twists_are_moved_to_the_body_that_the_extrinsics_describe(shared_data, name):
    drive = npz.read(shared_data / f"{name}.npz")
    given = npz.read(shared_data / f"{name}.npz", conventions=AS_GIVEN)
    assert drive.camera == given.camera
    np.testing.assert_array_equal(drive.twists[:, 3:], given.twists[:, 3:])
    imu = misplaced_imu(given.camera)
    np.testing.assert_allclose(
        given.twists[:, :3], drive.twists[:, :3] + np.cross(drive.twists[:, 3:], imu), atol=1e-12
    )
    # KITTI's left camera is 1.1 m ahead of its IMU, 0.3 m to its right and 0.7 m above it.
    camera = given.camera.T_body_camera[:3, 3] - imu
    np.testing.assert_allclose(camera, [1.1, -0.3, 0.7], atol=0.1)
    (finding,) = drive.findings
    assert finding.name == "twist_origin"
    assert drive.notes == (finding.note,)


@pytest.mark.parametrize("name", ["03", "0027", "0022", "0020"])
def test_the_twist_at_the_end_of_a_step_fits_best(shared_data, name):
    path = shared_data / f"{name}.npz"
    medians = {}
    for index in ("end", "start"):
        drive = npz.read(path, conventions=Conventions("flu", index))
        medians[index] = np.median(reprojection_errors(drive, step_pairs(drive)))
    assert medians["end"] < medians["start"]


@pytest.mark.parametrize("extrinsics", [unchanged, with_frd_extrinsics])
@pytest.mark.parametrize("twists", [unchanged, with_frd_twists])
def test_a_gyroscope_alone_tells_its_axes_too(drive, extrinsics, twists):
    turning = drive.moved_by("gyro")
    settled = settle_conventions(twists(extrinsics(turning)), AS_FOUND)
    assert_settled(settled, turning)


@pytest.mark.parametrize("name", ["03", "10_synthetic"])
def test_mixed_axes_are_mended_without_velocities(shared_data, name):
    whole = npz.read(shared_data / f"{name}.npz")
    raw = npz.read(shared_data / f"{name}.npz", conventions=AS_GIVEN)
    settled = settle_conventions(raw.moved_by("gyro"), AS_FOUND)
    assert settled.camera == whole.camera
    np.testing.assert_array_equal(settled.twists[:, 3:], whole.twists[:, 3:])
