# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with intrinsics and axes of their own cost nothing; poses that the rows deny do."""

import dataclasses

import numpy as np
import pytest
from course_files import course_content, save_course_file, turned_pair, unrectified
from places import SHARED_CASES

from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import tum_text
from vislam_ros.errors import VislamError

AS_GIVEN = Conventions("as-given", "end", "body", "imu-to-optical")
TURN = np.array([0.01, -0.02, 0.015])


@pytest.fixture(scope="module")
def drive():
    """A simulated drive whose pixels are whole eighths, and so exact in a file."""
    simulated = simulate(SimulationSettings(steps=40, landmarks=300, outlier_share=0.0)).drive
    return dataclasses.replace(simulated, pixels=np.round(simulated.pixels * 8) / 8)


def other_intrinsics(K):
    return K + np.array([[2.0, 0.0, -1.0], [0.0, 2.0, 0.5], [0.0, 0.0, 0.0]])


def with_right_camera(drive, theta, change=other_intrinsics):
    """Content of a file whose right camera is turned and has other intrinsics."""
    T_left_right = turned_pair(drive.camera.baseline, theta)
    content = course_content(drive, T_left_right=T_left_right)
    content["K_r"] = change(content["K_l"])
    features = content["features"]
    seen = np.any(features != -1, axis=0)
    features[:, seen] = unrectified(
        features[:, seen].T, content["K_l"], content["K_r"], T_left_right[:3, :3]
    ).T
    return content


def read(tmp_path, content):
    return npz.read(save_course_file(tmp_path / "drive.npy", content), conventions=AS_GIVEN)


@pytest.mark.parametrize("theta", [np.zeros(3), TURN], ids=["straight", "turned"])
def test_a_right_camera_of_its_own_gives_the_drive_of_the_rectified_pair(tmp_path, drive, theta):
    plain = read(tmp_path, course_content(drive))
    other = read(tmp_path, with_right_camera(drive, theta))
    assert other.camera == plain.camera
    np.testing.assert_array_equal(other.pixels, plain.pixels)
    np.testing.assert_array_equal(other.ids, plain.ids)
    assert tum_text(solve(other).trajectory) == tum_text(solve(plain).trajectory)
    assert not plain.notes
    assert other.notes[0] == "K_r differs from K_l by up to 2 px: mapped its pixels to K_l."
    assert len(other.notes) == (2 if theta.any() else 1)


def test_a_baseline_that_is_not_the_left_cameras_x_axis_turns_both(tmp_path, drive):
    content = with_right_camera(drive, np.zeros(3))
    higher = turned_pair(drive.camera.baseline, np.zeros(3))
    higher[1, 3] = -0.1
    content["extR_T_imu"] = np.linalg.inv(higher) @ content["extL_T_imu"]
    # What such cameras see of points far away, whose rows differ by the disparity's fifth.
    features = content["features"]
    seen = np.any(features != -1, axis=0)
    disparity = features[0, seen] - unrectify_u(content, features[2, seen])
    features[3, seen] += 0.1 / drive.camera.baseline * disparity
    turned = read(tmp_path, content)
    assert turned.camera.baseline == pytest.approx(np.hypot(drive.camera.baseline, 0.1))
    R = drive.camera.T_camera_body[:3, :3] @ turned.camera.T_body_camera[:3, :3]
    np.testing.assert_allclose(R[:, 0], higher[:3, 3] / np.linalg.norm(higher[:3, 3]), atol=1e-9)
    rows = np.median(np.abs(turned.pixels[:, 1] - turned.pixels[:, 3]))
    plain = read(tmp_path, course_content(drive))
    assert rows < 1.1 * np.median(np.abs(plain.pixels[:, 1] - plain.pixels[:, 3]))


def unrectify_u(content, u):
    K, K_right = content["K_l"], content["K_r"]
    return (u - K_right[0, 2]) / K_right[0, 0] * K[0, 0] + K[0, 2]


def test_poses_of_cameras_whose_images_are_rectified_already_turn_nothing(tmp_path, drive):
    T_left_right = turned_pair(drive.camera.baseline, TURN)
    content = course_content(drive, T_left_right=T_left_right)
    plain = read(tmp_path, course_content(drive))
    other = read(tmp_path, content)
    assert other.camera == plain.camera
    np.testing.assert_array_equal(other.pixels, plain.pixels)
    assert other.notes[0].startswith("Did not turn the cameras as extL_T_imu and extR_T_imu say")


def test_a_wrong_right_camera_is_named(tmp_path, drive):
    content = course_content(drive)
    content["K_r"] = np.eye(4)
    with pytest.raises(VislamError, match=r"drive.npy: K_r has shape \(4, 4\)"):
        read(tmp_path, content)


def test_pixels_of_k_r_in_a_file_cost_nothing():
    paths = [SHARED_CASES / "02_K_r_ignored" / f"{name}.npy" for name in ("k", "kf")]
    if not all(path.is_file() for path in paths):
        pytest.skip(f"needs 02_K_r_ignored, which is not in {SHARED_CASES}")
    one, other = (tum_text(solve(npz.read(path)).trajectory) for path in paths)
    assert one == other
