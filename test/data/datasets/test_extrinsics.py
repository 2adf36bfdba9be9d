# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The reading of a course file's extrinsics is found, and all of them give the same bytes."""

import dataclasses

import numpy as np
import pytest
from course_files import READINGS, course_content, save_course_file, turned_pair, unrectified
from places import SHARED_CASES

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.evaluation.evaluate import evaluate
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import read_tum, tum_text
from vislam_ros.errors import VislamError

CLEAN = SimulationSettings(
    steps=40,
    landmarks=200,
    pixel_noise_std=0.3,
    velocity_noise_std=0.02,
    angular_velocity_noise_std=0.002,
    outlier_share=0.0,
    gyro_bias=(0.0, 0.0, 0.0),
)


@pytest.fixture(scope="module")
def drive():
    """A simulated drive, in the package's convention."""
    return simulate(CLEAN).drive


def solved(path, **conventions):
    drive = npz.read(path, conventions=Conventions(**conventions))
    return drive, tum_text(solve(drive).trajectory)


def about_the_reading(drive):
    (note,) = [note for note in drive.notes if "extL_T_imu" in note]
    return note


@pytest.mark.parametrize("theta", [np.zeros(3), np.array([0.004, -0.01, 0.02])])
def test_a_file_of_each_reading_is_solved_to_the_same_bytes(tmp_path, drive, theta):
    T_left_right = turned_pair(drive.camera.baseline, theta)
    texts = set()
    for reading in READINGS:
        path = tmp_path / f"{reading}.npy"
        content = course_content(drive, reading, T_left_right)
        features = content["features"]
        seen = np.any(features != -1, axis=0)
        features[:, seen] = unrectified(
            features[:, seen].T, content["K_l"], content["K_r"], T_left_right[:3, :3]
        ).T
        save_course_file(path, content)
        read, text = solved(path)
        texts.add(text)
        assert "no other reading makes a stereo pair" in about_the_reading(read)
        np.testing.assert_allclose(
            read.camera.T_body_camera, drive.camera.T_body_camera, atol=1e-11
        )
        told, text = solved(path, extrinsics=reading)
        texts.add(text)
        assert not any("extL_T_imu as" in note for note in told.notes)
    assert len(texts) == 1


def test_a_reading_that_makes_no_pair_is_refused_where_it_is_asked_for(tmp_path, drive):
    path = save_course_file(tmp_path / "drive.npy", course_content(drive))
    with pytest.raises(VislamError, match=r"drive.npy: .* no stereo pair: as optical axes to IMU"):
        solved(path, extrinsics="optical-to-imu")


@pytest.mark.parametrize("reading", READINGS)
def test_the_images_decide_where_every_reading_makes_a_pair(tmp_path, drive, reading):
    content = course_content(drive, reading)
    del content["extR_T_imu"]
    content["b"] = drive.camera.baseline
    read, _ = solved(save_course_file(tmp_path / "drive.npy", content))
    assert "it fits the images best" in about_the_reading(read)
    np.testing.assert_allclose(read.camera.T_body_camera, drive.camera.T_body_camera, atol=1e-11)


def test_without_images_the_first_reading_that_makes_a_pair_is_taken(tmp_path, drive):
    content = course_content(drive, "optical-to-imu")
    del content["extR_T_imu"], content["features"]
    content["b"] = drive.camera.baseline
    read, _ = solved(save_course_file(tmp_path / "drive.npy", content))
    assert "too few landmarks to tell" in about_the_reading(read)
    np.testing.assert_allclose(read.camera.T_camera_body, drive.camera.T_body_camera, atol=1e-11)


def test_an_imu_with_optical_axes_is_read_too(tmp_path, drive):
    """The IMU of a camera has the camera's axes; the images need no axes of the twists for it."""
    T_body_camera = se3.exp([0.01, -0.02, 0.005, 0.0, 0.0, 0.0])
    camera = drive.camera
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    twists = drive.twists @ se3.adjoint(T_body_camera @ camera.T_camera_body).T
    own = dataclasses.replace(
        drive,
        camera=StereoCamera.from_matrices(K, camera.baseline, T_body_camera),
        twists=twists,
        ground_truth=None,
    )
    for reading in READINGS:
        path = save_course_file(tmp_path / f"{reading}.npy", course_content(own, reading))
        read = npz.read(path, conventions=Conventions("as-given", "end", "body"))
        np.testing.assert_allclose(read.camera.T_body_camera, T_body_camera, atol=1e-11)


def test_cameras_under_each_others_name_are_refused_although_some_reading_makes_them_a_pair(
    tmp_path, drive
):
    content = course_content(drive)
    content["extL_T_imu"], content["extR_T_imu"] = content["extR_T_imu"], content["extL_T_imu"]
    path = save_course_file(tmp_path / "drive.npy", content)
    with pytest.raises(VislamError, match="as IMU to optical axes the right camera lies") as error:
        npz.read(path)
    assert str(error.value).startswith(f"{path}: ")


def case(name):
    path = SHARED_CASES / name
    if not path.is_file():
        pytest.skip(f"needs {name}, which is not in {SHARED_CASES}: set VISLAM_SHARED_DATA")
    return path


def test_the_newest_course_file_is_solved_as_its_older_spelling():
    path = case("01_course_convention/course.npy")
    read, text = solved(path)
    assert text == solved(path.with_name("imu2opt.npy"))[1]
    assert "camera (x forward, y left, z up) to IMU" in about_the_reading(read)
    ate = evaluate(solve(read).trajectory, read_tum(path.with_name("course.tum"))).ate
    assert ate.rmse < 0.02
