# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks as the front end makes them, in an ``.npz`` file that gives back the very drive.

Its arrays (T frames, N twists, n observations)::

    vislam_tracks ()                          version of the format, 1
    stamps (T,), offsets (T + 1,)             nanoseconds; frame k has the rows offsets[k] to [k+1]
    ids (n,), pixels (n, 4), noise (n,)       u_left, v_left, u_right, v_right; noise is optional
    twist_stamps (N,), twists (N, 6)          nanoseconds; [v; omega], v NaN if not measured
    accelerations (N, 3)                      specific force, NaN if not measured; optional
    camera (12,), image_size (2,)             fields of StereoCamera in their order; pixels
    truth_stamps, truth_positions, truth_quaternions    the ground truth, optional
    name, notes                               UTF-8 as numbers of 8 bits; a note a line
"""

import dataclasses
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.ranges import (
    BASELINE,
    FOCAL_LENGTH,
    GAP,
    MOUNT,
    PIXEL,
    POSITION,
    PRINCIPAL_POINT,
    SPECIFIC_FORCE,
    TURN_RATE,
    VELOCITY,
)
from vislam_ros.data.datasets.arrays.array_stream import Arrays, open_arrays
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

_MARK, _VERSION = "vislam_tracks", 1
_CAMERA_NUMBERS = 12
_TRUTH = ("truth_stamps", "truth_positions", "truth_quaternions")
_ROTATION_TOLERANCE = 1e-3


def matches(path: Path) -> bool:
    """Whether a path is such a file, by what its archive lists."""
    if not (path.is_file() and path.suffix == ".npz"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return f"{_MARK}.npy" in archive.namelist()
    except Exception:  # damaged bytes raise errors of every kind; who reads it says so
        return False


def check_tracks_output(path: Path, *, force: bool) -> None:
    """Refuse an output with another suffix, or that exists and is not to be replaced.

    Raises
    ------
    VislamError
    """
    if path.suffix != ".npz":
        raise VislamError(f"{path}: tracks are an .npz file: end its name in .npz")
    refuse_existing(path, force=force)


def write_tracks(path: Path, drive: Drive, *, force: bool = False) -> None:
    """Write a drive; equal drives are equal files.

    Raises
    ------
    VislamError
        Where the path has another suffix, or the file exists or cannot be written.
    """
    check_tracks_output(path, force=force)
    arrays: dict[str, Any] = {
        _MARK: np.int64(_VERSION),
        "name": _bytes_of(drive.name),
        "notes": _bytes_of("\n".join(note.replace("\n", " ") for note in drive.notes)),
        "camera": np.hstack(dataclasses.astuple(drive.camera)),
        "image_size": np.array(drive.image_size, dtype=np.int64),
        "stamps": drive.feature_stamps,
        "offsets": drive.offsets,
        "ids": drive.ids,
        "pixels": drive.pixels,
        "twist_stamps": drive.twist_stamps,
        "twists": drive.twists,
    }
    if drive.noise is not None:
        arrays["noise"] = drive.noise
    if drive.accelerations is not None:
        arrays["accelerations"] = drive.accelerations
    if drive.ground_truth is not None:
        truth = drive.ground_truth
        arrays |= dict(
            zip(_TRUTH, (truth.stamps, truth.positions, truth.quaternions), strict=True)
        )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name, array in arrays.items():
            # A fixed date, so that the file depends on its arrays alone.
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array, order="C"))
    replace_file(path, content.getvalue())


def read(path: Path) -> Drive:
    """Read such a file.

    Raises
    ------
    VislamError
        Naming the array and what is wrong with it.
    """
    with open_arrays(path) as arrays:
        version = int(_read(path, arrays, _MARK, np.int64, ()))
        if version != _VERSION:
            raise VislamError(
                f"{path}: is of version {version} of this format, and {_VERSION} is known here: "
                "track the images anew"
            )
        stamps = _stamps(path, arrays, "stamps")
        offsets = _read(path, arrays, "offsets", np.int64, (len(stamps) + 1,))
        ids = _read(path, arrays, "ids", np.uint32, (None,))
        if offsets[0] != 0 or np.any(np.diff(offsets) < 0) or offsets[-1] != len(ids):
            raise VislamError(f"{path}: offsets do not go from 0 up to the {len(ids)} ids")
        _check_ids(path, ids, offsets)
        pixels = _read(path, arrays, "pixels", np.float32, (len(ids), 4))
        PIXEL.require(pixels, f"{path}: pixels")
        noise = None
        if "noise" in arrays:
            noise = _read(path, arrays, "noise", np.float32, (len(ids),))
            if not np.all(np.isfinite(noise) & (noise > 0)):
                raise VislamError(f"{path}: noise is not finite and above 0 everywhere")
        twist_stamps = _stamps(path, arrays, "twist_stamps")
        width, height = _read(path, arrays, "image_size", np.int64, (2,)).tolist()
        return Drive(
            name=_text(path, arrays, "name"),
            camera=_camera(path, arrays),
            image_size=(width, height),
            twist_stamps=twist_stamps,
            twists=_twists(path, arrays, len(twist_stamps)),
            feature_stamps=stamps,
            offsets=offsets,
            ids=ids,
            pixels=pixels,
            noise=noise,
            accelerations=_accelerations(path, arrays, len(twist_stamps)),
            ground_truth=_truth(path, arrays) if _TRUTH[0] in arrays else None,
            notes=tuple(filter(None, _text(path, arrays, "notes").split("\n"))),
        )


def _bytes_of(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode("utf-8"), dtype=np.uint8)


def _read(
    path: Path, arrays: Arrays, name: str, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Array of exactly a type and a shape, None in which stands for any length."""
    if name not in arrays:
        raise VislamError(f"{path}: has no {name}: track the images anew")
    stream = arrays[name]()
    fits = len(stream.shape) == len(shape) and all(
        wanted in (None, found) for wanted, found in zip(shape, stream.shape, strict=True)
    )
    if not fits or stream.dtype != np.dtype(dtype):
        raise VislamError(
            f"{path}: {name} is {stream.dtype} of shape {stream.shape}, not {np.dtype(dtype)} of "
            f"{shape}: track the images anew"
        )
    return stream.array(dtype)


def _stamps(path: Path, arrays: Arrays, name: str) -> NDArray[np.int64]:
    stamps = _read(path, arrays, name, np.int64, (None,))
    if not len(stamps) or stamps[0] < 0 or np.any(stamps[1:] <= stamps[:-1]):
        raise VislamError(f"{path}: {name} are none, negative, or do not increase")
    GAP.require(np.diff(stamps) / NANOSECONDS, f"{path}: {name}")
    return stamps


def _check_ids(path: Path, ids: NDArray[np.uint32], offsets: NDArray[np.int64]) -> None:
    begins = np.zeros(len(ids) + 1, dtype=bool)
    begins[offsets] = True
    bad = (ids[1:] <= ids[:-1]) & ~begins[1:-1]
    if bad.any():
        raise VislamError(
            f"{path}: ids[{int(np.argmax(bad)) + 1}] is not larger than the one before"
        )


def _twists(path: Path, arrays: Arrays, count: int) -> NDArray[np.float64]:
    twists = _read(path, arrays, "twists", np.float64, (count, 6))
    TURN_RATE.require(twists[:, 3:], f"{path}: twists")
    if not np.all(np.isnan(twists[:, :3])):
        VELOCITY.require(twists[:, :3], f"{path}: twists")
    return twists


def _accelerations(path: Path, arrays: Arrays, count: int) -> NDArray[np.float64] | None:
    if "accelerations" not in arrays:
        return None
    forces = _read(path, arrays, "accelerations", np.float64, (count, 3))
    SPECIFIC_FORCE.require(forces[~np.isnan(forces)], f"{path}: accelerations")
    return forces


def _camera(path: Path, arrays: Arrays) -> StereoCamera:
    values = _read(path, arrays, "camera", np.float64, (_CAMERA_NUMBERS,))
    where = f"{path}: camera"
    fx, fy, cx, cy, fx_baseline, x, y, z, qx, qy, qz, qw = values.tolist()
    FOCAL_LENGTH.require([fx, fy], where)
    PRINCIPAL_POINT.require([cx, cy], where)
    BASELINE.require(fx_baseline / fx, where)
    MOUNT.require([x, y, z], where)
    if not abs(np.linalg.norm(values[8:]) - 1.0) <= _ROTATION_TOLERANCE:
        raise VislamError(f"{where}: its quaternion is {values[8:].tolist()}, not of length 1")
    return StereoCamera(fx, fy, cx, cy, fx_baseline, (x, y, z), (qx, qy, qz, qw))


def _truth(path: Path, arrays: Arrays) -> Trajectory:
    stamps = _stamps(path, arrays, _TRUTH[0])
    positions = _read(path, arrays, _TRUTH[1], np.float64, (len(stamps), 3))
    quaternions = _read(path, arrays, _TRUTH[2], np.float64, (len(stamps), 4))
    POSITION.require(positions, f"{path}: {_TRUTH[1]}")
    lengths = np.linalg.norm(quaternions, axis=1)
    if not np.all(np.abs(lengths - 1.0) <= _ROTATION_TOLERANCE):
        raise VislamError(f"{path}: {_TRUTH[2]} are not of length 1")
    return Trajectory(stamps, positions, quaternions)


def _text(path: Path, arrays: Arrays, name: str) -> str:
    data = _read(path, arrays, name, np.uint8, (None,))
    try:
        return bytes(data.tolist()).decode("utf-8")
    except UnicodeDecodeError as error:
        raise VislamError(f"{path}: {name} is no text") from error
