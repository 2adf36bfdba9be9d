# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's calibrations: a name, a colon and numbers on each line."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera
from vislam_ros.core.ranges import FOCAL_LENGTH, MOUNT, PRINCIPAL_POINT
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
Fields = Mapping[str, Array]

_ROTATION_TOLERANCE = 1e-3


def read_fields(path: Path) -> dict[str, Array]:
    """Numbers of each line by its name; ``P0``, ``P1`` and so on where lines have none.

    Lines that hold no numbers, such as the date of the calibration, are passed over. What is no
    number among others is NaN.

    Raises
    ------
    VislamError
        Where the file cannot be read.
    """
    fields: dict[str, Array] = {}
    for _, line, _ in read_lines(path, "this calibration"):
        name, colon, rest = line.partition(":")
        texts = (rest if colon else line).split()
        numbers = np.array([_number(text) for text in texts])
        if not np.all(np.isnan(numbers)):
            fields[name.strip() if colon else f"P{len(fields)}"] = numbers
    return fields


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def numbers(path: Path, fields: Fields, name: str, count: int) -> Array:
    """Numbers (count,) of a line.

    Raises
    ------
    VislamError
        Where there is no such line, or it does not hold as many finite ones.
    """
    values = fields.get(name)
    if values is None:
        has = ", ".join(fields) or "no line of numbers"
        raise VislamError(f"{path}: has no {name}: it has {has}")
    if len(values) != count:
        raise VislamError(f"{path}: {name} holds {len(values)} numbers, not {count}")
    if not np.all(np.isfinite(values)):
        place = 1 + int(np.argmin(np.isfinite(values)))
        raise VislamError(f"{path}: {name}: number {place} is no finite number")
    return values


def projection(path: Path, fields: Fields, name: str) -> tuple[RawCamera, Array]:
    """Rectified camera of a projection matrix (3, 4), and its place (3,) in camera 0, metres.

    The size of the camera's images is not told.
    """
    P = numbers(path, fields, name, 12).reshape(3, 4)
    K = P[:, :3]
    FOCAL_LENGTH.require([K[0, 0], K[1, 1]], f"{path}: {name}")
    PRINCIPAL_POINT.require(K[:2, 2], f"{path}: {name}")
    rest = K - np.diag(np.diag(K))
    rest[:2, 2] = 0.0
    if np.any(rest) or K[2, 2] != 1.0:
        raise VislamError(f"{path}: {name} is no projection [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    place = np.asarray(-np.linalg.solve(K, P[:, 3]), dtype=np.float64)
    MOUNT.require(place, f"{path}: {name}")
    return RawCamera((0, 0), K.copy(), "", np.zeros(0)), place


def motion(path: Path, fields: Fields, R_name: str, T_name: str) -> Array:
    """Rigid motion (4, 4) of a line with a rotation and of one with a translation."""
    R = rotation(path, fields, R_name)
    t = numbers(path, fields, T_name, 3)
    MOUNT.require(t, f"{path}: {T_name}")
    return np.vstack([np.column_stack([R, t]), [0.0, 0.0, 0.0, 1.0]])


def rotation(path: Path, fields: Fields, name: str) -> Array:
    """Rotation (3, 3) of a line; a VislamError where it is none."""
    R = numbers(path, fields, name, 9).reshape(3, 3)
    if not np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
        raise VislamError(f"{path}: {name} is {R.tolist()}: no rotation")
    return se3.nearest_rotation(R)


def translation(place: Array) -> Array:
    """Pose (4, 4) without a turn at a place (3,)."""
    T = np.eye(4)
    T[:3, 3] = place
    return T
