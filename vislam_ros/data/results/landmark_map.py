# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmark maps as files: ``landmarks.npz`` to read back, ``landmarks.ply`` to look at."""

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.errors import VislamError

# Name, numpy kind and shape behind the number of landmarks, of each array in the file.
_ARRAYS = (
    ("ids", np.uint32, ()),
    ("generations", np.uint32, ()),
    ("positions", np.float64, (3,)),
    ("covariances", np.float64, (3, 3)),
)

# What numpy and zipfile raise for a file cut short, flipped bits, a lone array or a pickle.
_NOT_AN_ARCHIVE = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    AttributeError,
    zipfile.BadZipFile,
    zlib.error,
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
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise VislamError(f"{path}: no such landmark file") from error
    except _NOT_AN_ARCHIVE as error:
        raise VislamError(f"{path}: not a whole .npz file of landmarks") from error
    for name, dtype, shape in _ARRAYS:
        if name not in arrays:
            raise VislamError(f"{path}: has no array {name!r}: a landmark file needs it")
        array = arrays[name]
        expected = (len(arrays["ids"]) if arrays["ids"].ndim else 0, *shape)
        if array.shape != expected or not np.can_cast(array.dtype, dtype, "same_kind"):
            raise VislamError(
                f"{path}: {name} is {array.dtype} {array.shape}; "
                f"it must be {np.dtype(dtype)} {expected}"
            )
        if not np.all(np.isfinite(array)):
            raise VislamError(f"{path}: {name} holds a number that is not finite")
        arrays[name] = array.astype(dtype, copy=False)
    return LandmarkMap(**{name: arrays[name] for name, _, _ in _ARRAYS})


def write_point_cloud(path: Path, landmarks: LandmarkMap) -> None:
    """Write ``landmarks.ply``: x, y, z in metres and the id, as binary PLY that viewers open."""
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
    replace_file(path, header.encode("ascii") + points.tobytes())
