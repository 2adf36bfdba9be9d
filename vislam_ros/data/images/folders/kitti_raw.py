# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders of KITTI's raw recordings: ``image_00``, ``image_01`` and ``oxts`` of a drive.

The calibrations lie in the folder around it. The body is the inertial unit of ``oxts``. Images
that are not rectified, of the drives called ``extract``, are known by their size.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.core.ranges import FOCAL_LENGTH, PRINCIPAL_POINT
from vislam_ros.data.images.folders.kitti_calibration import (
    Fields,
    motion,
    numbers,
    projection,
    read_fields,
    rotation,
    translation,
)
from vislam_ros.data.images.folders.numbered_files import numbered_files
from vislam_ros.data.images.folders.oxts import read_oxts, read_stamps
from vislam_ros.data.images.image_file import FilePairs
from vislam_ros.data.images.pairing import half_a_period, pair_stamps, pairing_notes
from vislam_ros.data.images.reference_poses import from_first_pose
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# The grey cameras, and the coloured ones.
_PAIRS = (("00", "01"), ("02", "03"))
_CAMERAS, _VELO_TO_CAMERA, _IMU_TO_VELO = (
    "calib_cam_to_cam.txt",
    "calib_velo_to_cam.txt",
    "calib_imu_to_velo.txt",
)


def matches(path: Path) -> bool:
    """Whether a path is such a folder, of one drive."""
    return _pair(path) is not None


def lacks(path: Path) -> str | None:
    """What a folder that begins like such a one has not; None where it is another kind."""
    for pair in _PAIRS:
        folders = [f"image_{name}/data" for name in pair]
        missing = [name for name in folders if not (path / name).is_dir()]
        if len(missing) == 1:
            return f"{path}: has no {missing[0]}: both cameras are needed"
    return None


def read(path: Path) -> StereoImages:
    """Open the folder of a drive.

    Raises
    ------
    VislamError
        Naming the file and what is wrong with it.
    """
    pair = _pair(path)
    if pair is None:
        raise VislamError(f"{path}: holds no image_00/data and image_01/data")
    notes: list[str] = []
    lefts, rights = (_images(path / f"image_{name}", notes) for name in pair)
    left_stamps, right_stamps = (np.array(list(each), dtype=np.int64) for each in (lefts, rights))
    paired = pair_stamps(left_stamps, right_stamps, half_a_period(left_stamps))
    notes += pairing_notes(left_stamps, right_stamps, paired)
    if not len(paired.first):
        raise VislamError(f"{path}: has no image of image_{pair[0]} with one of image_{pair[1]}")
    left_files, right_files = list(lefts.values()), list(rights.values())
    files = FilePairs(
        [
            (left_files[k], right_files[m])
            for k, m in zip(paired.first.tolist(), paired.second.tolist(), strict=True)
        ]
    )
    stamps = left_stamps[paired.first]
    rig = _rig(path.resolve().parent, pair, files)
    oxts = read_oxts(path / "oxts", notes) if (path / "oxts").is_dir() else None
    return StereoImages(
        name=path.resolve().name,
        rig=rig,
        stamps=stamps,
        places=range(len(stamps)),
        reader=files,
        motion=None if oxts is None else oxts.motion,
        ground_truth=None
        if oxts is None
        else from_first_pose(oxts.motion.stamps, oxts.T_world_imu, stamps),
        notes=tuple(notes),
    )


def _pair(path: Path) -> tuple[str, str] | None:
    for left, right in _PAIRS:
        if all((path / f"image_{name}" / "data").is_dir() for name in (left, right)):
            return left, right
    return None


def _images(folder: Path, notes: list[str]) -> dict[int, Path]:
    """Images of a camera by their stamps, in the order of these."""
    times = folder / "timestamps.txt"
    stamps = read_stamps(times)
    files = numbered_files(folder / "data")
    if max(files) >= len(stamps):
        raise VislamError(f"{times}: has {len(stamps)} times, none for image {max(files)}")
    images: dict[int, Path] = {}
    for number, file in files.items():
        images.setdefault(int(stamps[number]), file)
    if twice := len(files) - len(images):
        notes.append(f"Left out {twice} images of {folder.name} that repeat a time.")
    return dict(sorted(images.items()))


def _rig(calibrations: Path, pair: tuple[str, str], files: FilePairs) -> StereoRig:
    cameras = calibrations / _CAMERAS
    fields = read_fields(cameras)
    sizes = [tuple(numbers(cameras, fields, f"S_{name}", 2).astype(int).tolist()) for name in pair]
    are_raw = [size == of_camera for size, of_camera in zip(files.sizes, sizes, strict=True)]
    T_camera0_velo = motion(
        calibrations / _VELO_TO_CAMERA, read_fields(calibrations / _VELO_TO_CAMERA), "R", "T"
    )
    T_velo_imu = motion(
        calibrations / _IMU_TO_VELO, read_fields(calibrations / _IMU_TO_VELO), "R", "T"
    )
    build = _raw if all(are_raw) else _rectified
    (left, T_camera0_left), (right, T_camera0_right) = (
        build(cameras, fields, name) for name in pair
    )
    return StereoRig(
        *files.sized(left, right),
        T_left_right=se3.inverse(T_camera0_left) @ T_camera0_right,
        T_body_left=se3.inverse(T_camera0_velo @ T_velo_imu) @ T_camera0_left,
    )


def _rectified(path: Path, fields: Fields, name: str) -> tuple[RawCamera, Array]:
    """Rectified camera and its pose in camera 0 as that one took its images."""
    camera, place = projection(path, fields, f"P_rect_{name}")
    T_rectified_camera0 = np.eye(4)
    T_rectified_camera0[:3, :3] = rotation(path, fields, "R_rect_00")
    return camera, se3.inverse(T_rectified_camera0) @ translation(place)


def _raw(path: Path, fields: Fields, name: str) -> tuple[RawCamera, Array]:
    """Camera with its lens, and its pose in camera 0."""
    K = numbers(path, fields, f"K_{name}", 9).reshape(3, 3)
    D = numbers(path, fields, f"D_{name}", 5)
    FOCAL_LENGTH.require([K[0, 0], K[1, 1]], f"{path}: K_{name}")
    PRINCIPAL_POINT.require(K[:2, 2], f"{path}: K_{name}")
    T_camera_camera0 = motion(path, fields, f"R_{name}", f"T_{name}")
    return RawCamera((0, 0), K, "plumb_bob", D), se3.inverse(T_camera_camera0)
