# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders as those of KITTI's odometry benchmark: ``image_0``, ``image_1``, ``calib.txt``.

The images are rectified. ``times.txt`` holds the seconds of the frames, and ``poses/XX.txt``
beside the sequences the reference of camera 0. The folder holds no motion: camera 0 stands for the
body until something else tells it.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.ranges import POSITION
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.data.images.folders.kitti_calibration import projection, read_fields, translation
from vislam_ros.data.images.folders.numbered_files import frame_times, numbered_pairs
from vislam_ros.data.images.image_file import FilePairs
from vislam_ros.data.images.reference_poses import from_first_pose
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.trajectory import LATEST_SECOND, Trajectory, nanoseconds
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# Folders of left and right, and their projections in calib.txt.
_LAYOUTS = (
    ("image_0", "image_1", "P0", "P1"),
    ("image_2", "image_3", "P2", "P3"),
    ("image_l", "image_r", "P0", "P1"),
)
_CALIBRATION = "calib.txt"


def matches(path: Path) -> bool:
    """Whether a path is such a folder."""
    return (path / _CALIBRATION).is_file() and _layout(path) is not None


def lacks(path: Path) -> str | None:
    """What a folder that begins like such a one has not; None where it is another kind."""
    for left, right, *_ in _LAYOUTS:
        if (path / left).is_dir():
            missing = [name for name in (right, _CALIBRATION) if not (path / name).exists()]
            found = f"{path}: has {left} and no {' and no '.join(missing)}: a pair needs all three"
            return found if missing else None
    return None


def read(path: Path) -> StereoImages:
    """Open such a folder.

    Raises
    ------
    VislamError
        Naming the file and what is wrong with it.
    """
    layout = _layout(path)
    if layout is None:
        raise VislamError(f"{path}: holds no folders image_0 and image_1, or image_2 and image_3")
    left_folder, right_folder, P_left, P_right = layout
    notes: list[str] = []
    calibration = path / _CALIBRATION
    fields = read_fields(calibration)
    left, place_left = projection(calibration, fields, P_left)
    right, place_right = projection(calibration, fields, P_right)
    if not place_right[0] > place_left[0]:
        raise VislamError(
            f"{calibration}: {P_right} has the right camera {place_right[0] - place_left[0]:g} m "
            f"to the right of that of {P_left}: its fourth number must be smaller"
        )
    numbers, files = numbered_pairs(path / left_folder, path / right_folder, notes)
    pairs = FilePairs(files)
    times = _times(path / "times.txt", numbers)
    stamps = np.array(numbers, dtype=np.int64) if times is None else times
    truth = None if times is None else _reference(path, numbers, times)
    return StereoImages(
        name=path.resolve().name,
        rig=StereoRig(
            *pairs.sized(left, right),
            T_left_right=translation(place_right - place_left),
            T_body_left=translation(place_left),
        ),
        stamps=stamps,
        places=range(len(files)),
        reader=pairs,
        timed=times is not None,
        ground_truth=truth,
        notes=tuple(notes),
    )


def _layout(path: Path) -> tuple[str, str, str, str] | None:
    for layout in _LAYOUTS:
        if (path / layout[0]).is_dir() and (path / layout[1]).is_dir():
            return layout
    return None


def _times(path: Path, numbers: list[int]) -> NDArray[np.int64] | None:
    """Stamps (T,) of some frames; None where there is no such file."""
    if not path.exists():
        return None
    seconds = frame_times(path, "these times", float, "seconds")
    if numbers[-1] >= len(seconds):
        raise VislamError(
            f"{path}: has {len(seconds)} times, none for image {numbers[-1]}: one a line is needed"
        )
    chosen = np.array(seconds)[numbers]
    if not np.all((chosen >= 0) & (chosen <= LATEST_SECOND)):
        raise VislamError(f"{path}: holds a time that is none: give seconds from 0 on")
    stamps = nanoseconds(chosen)
    if np.any(np.diff(stamps) <= 0):
        k = int(np.argmax(np.diff(stamps) <= 0)) + 1
        raise VislamError(
            f"{path}: line {numbers[k] + 1} is not later than that of the image before"
        )
    return stamps


def _reference(path: Path, numbers: list[int], stamps: NDArray[np.int64]) -> Trajectory | None:
    """Poses of camera 0 at the frames, where the benchmark's file lies beside the sequences."""
    sequence = path.resolve()
    name = f"{sequence.name}.txt"
    folders = (sequence, sequence.parent, sequence.parent.parent)
    file = next((f / "poses" / name for f in folders if (f / "poses" / name).is_file()), None)
    if file is None:
        return None
    rows: list[list[float]] = []
    for number, line, _ in read_lines(file, "these poses"):
        try:
            row = [float(text) for text in line.split()]
        except ValueError:
            row = []
        if len(row) != 12 or not np.all(np.isfinite(row)):
            raise VislamError(f"{file}: line {number} is no pose of 12 finite numbers")
        rows.append(row)
    if numbers[-1] >= len(rows):
        raise VislamError(f"{file}: has {len(rows)} poses, none for image {numbers[-1]}")
    T_world_camera = np.tile(np.eye(4), (len(numbers), 1, 1))
    T_world_camera[:, :3] = np.array(rows)[numbers].reshape(-1, 3, 4)
    POSITION.require(T_world_camera, str(file))
    return from_first_pose(stamps, T_world_camera, stamps)
