# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmark maps as files: ``landmarks.npz`` to read back, ``landmarks.ply`` to look at."""

import io
from pathlib import Path

import numpy as np

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.ranges import POSITION
from vislam_ros.data.datasets.arrays.array_stream import open_arrays
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.errors import VislamError

# Name, numpy kind and shape behind the number of landmarks, of each array in the file.
_ARRAYS = (
    ("ids", np.uint32, ()),
    ("generations", np.uint32, ()),
    ("positions", np.float64, (3,)),
    ("covariances", np.float64, (3, 3)),
)

_PLY_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<u4")])


def write_landmarks(path: Path, landmarks: LandmarkMap) -> None:
    """Write ``landmarks.npz``: every array of the map under its own name, in metres."""
    buffer = io.BytesIO()
    np.savez(buffer, **{name: getattr(landmarks, name) for name, _, _ in _ARRAYS})
    replace_file(path, buffer.getvalue())


def read_landmarks(path: Path) -> LandmarkMap:
    """Read ``landmarks.npz``.

    Raises
    ------
    VislamError
        Where the file is missing or damaged, or an array is missing, has the wrong type or
        shape, or holds a number that is not finite.
    """
    arrays = {}
    count: int | None = None
    with open_arrays(path, "these landmarks") as streams:
        for name, dtype, shape in _ARRAYS:
            if name not in streams:
                raise VislamError(f"{path}: has no array {name!r}: a landmark file needs it")
            stream = streams[name]()
            if count is None:
                count = stream.shape[0] if stream.shape else 0
            expected = (count, *shape)
            if stream.shape != expected or not np.can_cast(stream.dtype, dtype, "same_kind"):
                raise VislamError(
                    f"{path}: {name} is {stream.dtype} {stream.shape}; "
                    f"it must be {np.dtype(dtype)} {expected}"
                )
            arrays[name] = stream.array(dtype)
            if not np.all(np.isfinite(arrays[name])):
                raise VislamError(f"{path}: {name} holds a number that is not finite")
    POSITION.require(arrays["positions"], f"{path}: positions")
    return LandmarkMap(**arrays)


def write_point_cloud(path: Path, landmarks: LandmarkMap) -> None:
    """Write ``landmarks.ply``: see :func:`point_cloud`."""
    replace_file(path, point_cloud(landmarks))


def point_cloud(landmarks: LandmarkMap) -> bytes:
    """x, y, z in metres and the id of each landmark, as binary PLY that viewers open."""
    points = np.empty(len(landmarks), dtype=_PLY_POINT)
    for axis, name in enumerate(("x", "y", "z")):
        points[name] = landmarks.positions[:, axis]
    points["id"] = landmarks.ids
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uint id\n"
        "end_header\n"
    )
    return header.encode("ascii") + points.tobytes()
