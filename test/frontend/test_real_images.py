# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fifty-one pairs of a drive through a street, and a drone that stands: what they are good for."""

import dataclasses
import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from places import SHARED_DATA

import vislam_ros as vi
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.data.trajectory import path_length
from vislam_ros.frontend.rectification import Rectification
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import StereoTracker, Tracked

Grey = NDArray[np.uint8]
STREET = SHARED_DATA.parent / "images" / "kitti_0020"
DRONE = SHARED_DATA.parent / "images" / "euroc_v101" / "mav0"


@pytest.fixture(scope="module")
def street(shared_data: Path) -> vi.Drive:
    """The drive's twists and camera, for as many frames as there are images."""
    names = sorted(STREET.glob("image_l/*.png"))
    if not names:
        pytest.skip(f"needs the images of {STREET}: set VISLAM_SHARED_DATA")
    whole = vi.load_drive(shared_data / "0020.npz")
    truth = vi.read_tum(shared_data / "ground_truth" / "0020.tum")
    kept = slice(len(names))
    known = dataclasses.replace(
        truth,
        stamps=truth.stamps[kept],
        positions=truth.positions[kept],
        quaternions=truth.quaternions[kept],
    )
    stamps, twists, camera = whole.feature_stamps[kept], whole.twists[kept], whole.camera
    frames = []
    tracker = None
    for k, name in enumerate(names):
        left, right = (
            np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
            for path in (name, STREET / "image_r" / name.name)
        )
        tracker = tracker or StereoTracker(camera, (left.shape[1], left.shape[0]))
        turned = (stamps[k] - stamps[k - 1]) * 1e-9 * twists[k, 3:] if k else np.zeros(3)
        R_camera_body = camera.T_camera_body[:3, :3]
        R = R_camera_body @ se3.exp_rotation(-turned) @ R_camera_body.T
        frames.append(tracker.track(left, right, R))
    return vi.Drive.from_tracks(
        stamps,
        [frame.ids for frame in frames],
        [frame.pixels for frame in frames],
        twists,
        camera,
        ground_truth=known,
    )


def test_a_street_has_many_points_in_every_frame(street: vi.Drive) -> None:
    counts = np.diff(street.offsets)
    assert counts[1:].min() > 100


def test_images_are_no_worse_than_a_clean_twist(street: vi.Drive) -> None:
    solution = vi.solve(street)
    truth = street.ground_truth
    assert truth is not None
    ate = vi.evaluate(solution.trajectory, truth).ate.rmse
    alone = vi.evaluate(solution.dead_reckoning, truth).ate.rmse
    assert ate < alone
    assert abs(path_length(solution.trajectory) / path_length(truth) - 1) < 0.005


def test_images_make_up_for_a_useless_velocity(street: vi.Drive) -> None:
    noisy = street.twists.copy()
    noisy[:, :3] += np.random.default_rng(0).normal(0, 5, noisy[:, :3].shape)
    truth = street.ground_truth
    assert truth is not None
    solution = vi.solve(dataclasses.replace(street, twists=noisy))
    alone = vi.evaluate(solution.dead_reckoning, truth).ate.rmse
    assert vi.evaluate(solution.trajectory, truth).ate.rmse < 0.15 * alone
    assert abs(path_length(solution.trajectory) / path_length(truth) - 1) < 0.015


def drone_camera(name: str) -> tuple[RawCamera, NDArray[np.float64]]:
    """Camera of a sensor.yaml, and its pose in the body."""
    text = (DRONE / name / "sensor.yaml").read_text().split("\n", 1)[1]
    given = yaml.safe_load(text)
    fu, fv, cu, cv = given["intrinsics"]
    width, height = given["resolution"]
    K = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
    D = np.array(given["distortion_coefficients"])
    pose = np.array(given["T_BS"]["data"]).reshape(4, 4)
    return RawCamera((width, height), K, "plumb_bob", D), pose


@pytest.fixture(scope="module")
def drone() -> list[Tracked]:
    """Tracks of a standing drone, rectified, without a gyroscope."""
    if not DRONE.is_dir():
        pytest.skip(f"needs the images of {DRONE}: set VISLAM_SHARED_DATA")
    (left, T_left), (right, T_right) = drone_camera("cam0"), drone_camera("cam1")
    rectification = Rectification(StereoRig(left, right, se3.inverse(T_left) @ T_right, T_left))
    tracker = StereoTracker(
        rectification.camera, rectification.image_size, TrackerSettings(max_features=150)
    )
    frames = []
    for path in sorted((DRONE / "cam0" / "data").glob("*.png"))[:15]:
        pair = [
            np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8)
            for file in (path, DRONE / "cam1" / "data" / path.name)
        ]
        frames.append(tracker.track(*rectification.rectify(*pair)))
    return frames


def test_a_standing_drones_points_stay_and_its_rows_agree(drone: list[Tracked]) -> None:
    first, last = drone[0], drone[-1]
    assert np.isin(first.ids, last.ids).mean() > 0.8
    rows = np.concatenate([frame.pixels[:, 1] - frame.pixels[:, 3] for frame in drone])
    assert abs(np.median(rows)) < 0.1
    assert np.median(np.abs(rows)) < 0.15


def test_a_standing_drones_noise_is_stated(drone: list[Tracked]) -> None:
    whitened = []
    for before, now in itertools.pairwise(drone):
        _, a, b = np.intersect1d(before.ids, now.ids, return_indices=True)
        change = now.pixels[b, :2] - before.pixels[a, :2]
        # The drone hangs on, and sways a little.
        change -= np.median(change, axis=0)
        whitened.append(change / np.hypot(now.noise[b], before.noise[a])[:, None])
    assert 0.3 < 1.4826 * np.median(np.abs(np.concatenate(whitened))) < 1.3
