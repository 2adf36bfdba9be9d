# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders of the ASL format, as EuRoC's: ``mav0`` with ``cam0``, ``cam1`` and ``imu0``.

The body is the IMU; its axes are those of the file. Reference poses are taken from
``state_groundtruth_estimate0``, or another tracker's folder with poses.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.ranges import POSITION, SPECIFIC_FORCE, TURN_RATE
from vislam_ros.data.images.folders.asl_sensors import (
    CameraOnBody,
    read_camchain,
    read_camera,
    read_sensor_pose,
)
from vislam_ros.data.images.folders.stamped_rows import read_names, read_numbers
from vislam_ros.data.images.image_file import FilePairs
from vislam_ros.data.images.pairing import half_a_period, pair_stamps, pairing_notes
from vislam_ros.data.images.reference_poses import from_first_pose
from vislam_ros.data.images.stereo_images import Motion, StereoImages
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_CAMERAS = ("cam0", "cam1")
_IMU = "imu0"
# Of all the sets there are: EuRoC's estimate, its Vicon, TUM's motion capture.
_REFERENCES = ("state_groundtruth_estimate0", "vicon0", "mocap0", "gt0")
_TABLE = "data.csv"
# Kalibr's calibration, where the sensors' folders hold none.
_CAMCHAINS = ("camchain.yaml", "../camchain.yaml", "../dso/camchain.yaml")


def matches(path: Path) -> bool:
    """Whether a path is such a folder, ``mav0`` itself or the one around it."""
    return _root(path) is not None


def lacks(path: Path) -> str | None:
    """What a folder that begins like such a one has not; None where it is another kind."""
    for root in (path / "mav0", path):
        if any((root / camera).is_dir() for camera in _CAMERAS):
            tables = [f"{camera}/{_TABLE}" for camera in _CAMERAS]
            missing = [table for table in tables if not (root / table).is_file()]
            found = f"{root}: has no {' and no '.join(missing)}: both cameras' tables are needed"
            return found if missing else None
    return None


def read(path: Path) -> StereoImages:
    """Open such a folder.

    Raises
    ------
    VislamError
        Naming the file, the line or field, and what is wrong with it.
    """
    root = _root(path)
    if root is None:
        raise VislamError(f"{path}: holds no mav0 with cam0 and cam1 and their {_TABLE}")
    notes: list[str] = []
    cameras = {name: _camera(root, name) for name in _CAMERAS}
    left, right = _sides(cameras, notes)
    files = [_files(root, name, notes) for name in (left, right)]
    left_stamps, right_stamps = (np.array(list(each), dtype=np.int64) for each in files)
    pairs = pair_stamps(left_stamps, right_stamps, half_a_period(left_stamps))
    notes += pairing_notes(left_stamps, right_stamps, pairs)
    if not len(pairs.first):
        raise VislamError(f"{root}: has no image of {left} with one of {right} at its stamp")
    lefts, rights = (list(each.values()) for each in files)
    of_pairs = [
        (lefts[k], rights[m])
        for k, m in zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)
    ]
    stamps = left_stamps[pairs.first]
    T_body_imu = _pose_of_imu(root)
    motion = _motion(root, notes) if T_body_imu is not None else None
    T_imu_body = se3.inverse(np.eye(4) if T_body_imu is None else T_body_imu)
    files_of_pairs = FilePairs(of_pairs)
    rig = StereoRig(
        *files_of_pairs.sized(cameras[left].camera, cameras[right].camera),
        T_left_right=se3.inverse(cameras[left].T_body_camera) @ cameras[right].T_body_camera,
        T_body_left=T_imu_body @ cameras[left].T_body_camera,
    )
    return StereoImages(
        name=(path.resolve().parent if path.resolve() == root.resolve() else path.resolve()).name,
        rig=rig,
        stamps=stamps,
        places=range(len(of_pairs)),
        reader=files_of_pairs,
        motion=motion,
        ground_truth=_reference(root, T_imu_body, stamps, notes),
        notes=tuple(notes),
    )


def _root(path: Path) -> Path | None:
    """Folder that holds the cameras' folders."""
    for root in (path / "mav0", path):
        if all((root / camera / _TABLE).is_file() for camera in _CAMERAS):
            return root
    return None


def _camera(root: Path, name: str) -> CameraOnBody:
    sensor = root / name / "sensor.yaml"
    if not sensor.exists():
        for chain in _CAMCHAINS:
            if (root / chain).is_file():
                return read_camchain(root / chain, name)
    return read_camera(sensor)


def _sides(cameras: dict[str, CameraOnBody], notes: list[str]) -> tuple[str, str]:
    """Names of the left camera and of the right one, which lies on its x axis."""
    first, second = _CAMERAS
    between = se3.inverse(cameras[first].T_body_camera) @ cameras[second].T_body_camera
    if between[0, 3] >= 0.0:
        return first, second
    notes.append(f"{second} lies to the left of {first}: taken as the left camera.")
    return second, first


def _files(root: Path, name: str, notes: list[str]) -> dict[int, Path]:
    """Files of a camera's images by their stamps, of those that are there."""
    folder = root / name / "data"
    named = read_names(root / name / _TABLE)
    there = {each.name for each in folder.iterdir()} if folder.is_dir() else set()
    files = {stamp: folder / file for stamp, file in named.items() if file in there}
    if not files:
        raise VislamError(f"{folder}: holds none of the {len(named)} images in {name}/{_TABLE}")
    if missing := len(named) - len(files):
        notes.append(f"{missing} images of {name} are not there: their frames are left out.")
    return files


def _pose_of_imu(root: Path) -> Array | None:
    """Pose of the IMU in the frame that the other sensors' poses are given in; None without."""
    if not (root / _IMU / _TABLE).is_file():
        return None
    sensor = root / _IMU / "sensor.yaml"
    return read_sensor_pose(sensor) if sensor.exists() else np.eye(4)


def _motion(root: Path, notes: list[str]) -> Motion:
    path = root / _IMU / _TABLE
    stamps, values = read_numbers(path, 6, notes)
    TURN_RATE.require(values[:, :3], str(path))
    SPECIFIC_FORCE.require(values[:, 3:], str(path))
    return Motion.of_imu(stamps, values[:, :3], values[:, 3:])


def _reference(
    root: Path, T_imu_body: Array, stamps: NDArray[np.int64], notes: list[str]
) -> Trajectory | None:
    """Reference poses of the IMU in the time of the images."""
    for name in _REFERENCES:
        path = root / name / _TABLE
        if not path.is_file():
            continue
        times, values = read_numbers(path, 7, notes)
        POSITION.require(values[:, :3], str(path))
        sensor = root / name / "sensor.yaml"
        T_body_sensor = read_sensor_pose(sensor) if sensor.exists() else np.eye(4)
        # The tables have w first.
        T_world_sensor = se3.pose_matrix(values[:, :3], values[:, [4, 5, 6, 3]])
        T_sensor_imu = se3.inverse(T_imu_body @ T_body_sensor)
        return from_first_pose(times, T_world_sensor @ T_sensor_imu, stamps)
    return None
