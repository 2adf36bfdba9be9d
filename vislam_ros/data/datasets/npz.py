# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's format: dense arrays in an ``.npz`` file, or in a dict in an ``.npy`` file.

The format (M tracks, T steps), in every spelling in use; velocities may be transposed::

    features (4, M, T)   u_left, v_left, u_right, v_right in pixels; all four -1 or 0 where unseen;
                         in another order where the lengths leave no doubt; may be missing
    time_stamps, timestamps (T,)                           UNIX seconds
    linear_velocity, v_t (3, T)                            metres a second, in the IMU's axes;
                                                           missing or all NaN: a gyroscope alone
    angular_velocity, rotational_velocity, w_t (3, T)      radians a second, in the IMU's axes
    K, K_l (3, 3)                                          intrinsics; K_r where they differ
    b, baseline                                            metres; or extL_T_imu and extR_T_imu
    imu_T_cam (camera to IMU); cam_T_imu (IMU to left camera); extL_T_imu (see extrinsics) (4, 4)
    ground_truth_T_world_body (T, 4, 4)                    in simulated files
"""

from itertools import permutations
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.ranges import GAP, LARGEST_PIXEL, POSITION, TURN_RATE, VELOCITY, Range
from vislam_ros.data.datasets.arrays.array_stream import Arrays, open_arrays
from vislam_ros.data.datasets.calibration import ReadPair, read_pairs
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions, settle_conventions
from vislam_ros.data.datasets.extrinsics import Candidate, choose_reading, quick_error
from vislam_ros.data.datasets.members import finite, wrong_shape
from vislam_ros.data.datasets.mending import AS_STORED, Mending, mended_stamps
from vislam_ros.data.datasets.principal_point import with_left_column
from vislam_ros.data.datasets.sparse_features import (
    Axes,
    DenseFeatures,
    Progress,
    gather_observations,
    no_features,
    rectified,
)
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.finding import Finding
from vislam_ros.data.missing_motion import filled, missing_samples
from vislam_ros.data.trajectory import LATEST_SECOND, NANOSECONDS, Trajectory, nanoseconds
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

FEATURES = "features"
NO_FEATURES = "There are no features: what is left is dead reckoning."
LINEAR_VELOCITY = ("linear_velocity", "v_t")
ALL_NAN = "All velocities are NaN: the gyroscope alone tells the motion."
NO_VELOCITY = "There are no velocities: the gyroscope alone tells the motion."
SPELLINGS = {
    "time stamps": ("time_stamps", "timestamps"),
    "angular velocity": ("angular_velocity", "rotational_velocity", "w_t"),
    "intrinsics": ("K", "K_l"),
    "baseline": ("b", "baseline", "extR_T_imu"),
    "extrinsics": ("imu_T_cam", "cam_T_imu", "extL_T_imu"),
}
# UNIX seconds in fewer bytes are minutes apart.
_SECONDS = np.dtype(np.float64)
GROUND_TRUTH = "ground_truth_T_world_body"
# Read together with another key, or known and of no use here.
_COMPANIONS = ("K_r", "extL_T_imu", "extR_T_imu", GROUND_TRUTH, "ground_truth_landmarks")


def matches(path: Path) -> bool:
    """Whether a path looks like such a file, by its name."""
    return path.is_file() and path.suffix in (".npz", ".npy")


def read(
    path: Path,
    *,
    conventions: Conventions = AS_FOUND,
    progress: Progress | None = None,
    mending: Mending = AS_STORED,
) -> Drive:
    """Read a dataset; the dense features are streamed and never held.

    Parameters
    ----------
    path : Path
        An ``.npz`` or ``.npy`` file.
    conventions : Conventions, optional
        What the file's numbers mean; by default what fits its images.
    progress : callable, optional
        Told the share of the features read so far, 0 to 1.
    mending : Mending, optional
        Faults that are undone.

    Returns
    -------
    Drive
        With what was repaired or left out in its notes.

    Raises
    ------
    VislamError
        Where the file cannot be read or is no dataset; the message names the field.
    """
    return read_with_rectification(path, conventions, progress, mending)[0]


def read_with_rectification(
    path: Path,
    conventions: Conventions = AS_FOUND,
    progress: Progress | None = None,
    mending: Mending = AS_STORED,
) -> tuple[Drive, PixelRectification | None]:
    """Read a dataset as :func:`read` does, and what its raw pixels went through."""
    with open_arrays(path) as arrays:
        keys = {what: _find_key(path, arrays, what) for what in SPELLINGS}
        stamps, late = _stamps(path, arrays, keys["time stamps"], mending)
        velocity, notes = _linear_velocity(path, arrays, len(stamps))
        omega = keys["angular velocity"]
        angular_velocity = _velocity(path, arrays, omega, len(stamps), TURN_RATE)
        twists = np.column_stack([velocity, angular_velocity])
        missing = missing_samples(twists, str(path))
        readings = read_pairs(path, arrays, keys, conventions.extrinsics)
        truth = _ground_truth(path, arrays, stamps) if GROUND_TRUTH in arrays else None
        known = {*keys.values(), *LINEAR_VELOCITY, FEATURES, *_COMPANIONS}
        unknown = sorted(set(arrays) - known)
        features, of_features = _features(path, arrays, len(stamps), progress)
        features = mending.features(features)
    notes += of_features

    if unknown:
        notes.append(f"Ignored keys that are no part of the format: {', '.join(unknown)}.")

    def candidate(pair: ReadPair, rectification: PixelRectification | None) -> Candidate:
        seen = rectified(features, rectification)
        left_out = seen.unusable and (
            f"Left out {seen.unusable} observations with a pixel that is not finite or beyond "
            f"{LARGEST_PIXEL:.0f}."
        )
        drive = Drive(
            name=path.stem,
            camera=mending.camera(pair.camera),
            image_size=image_size_that_holds(seen.pixels),
            twist_stamps=stamps,
            twists=filled(twists, missing),  # until its conventions are settled
            feature_stamps=stamps,
            offsets=seen.offsets,
            ids=seen.ids,
            pixels=seen.pixels,
            ground_truth=truth,
            notes=(*notes, *([left_out] if left_out else []), *pair.notes),
        )
        complaint = pair.complaint and f"{path}: {pair.complaint}"
        return Candidate(pair.reading, drive, complaint)

    pairs = [reading.fitting(features.pixels) for reading in readings]
    candidates = [candidate(pair, pair.rectification) for pair in pairs]

    def right_camera(place: int) -> Finding | None:
        """Whether the right principal point of a candidate is off."""
        other = with_left_column(pairs[place].rectification)
        if other is None:
            return None
        rectification, points = other
        drives = candidates[place].drive, candidate(pairs[place], rectification).drive
        return points.finding(*(quick_error(drive, conventions) for drive in drives))

    try:
        chosen, drive = choose_reading(candidates, conventions)
    except VislamError as error:
        # A wrong depth may fit wrong axes better than the right ones.
        if off := right_camera(0):
            raise VislamError(f"{path}: {off.words}: {off.advice}") from error
        raise
    if off := right_camera(chosen):
        drive = drive.with_finding(off)
    if late is not None:
        drive = drive.with_finding(late)
    drive = settle_conventions(drive, conventions)
    if any(each.name == "twist_index" for each in drive.findings):
        missing = np.concatenate([missing[:1], missing[:-1]])
    return drive.without_samples(missing), pairs[chosen].rectification


def _find_key(path: Path, arrays: Arrays, what: str) -> str:
    for key in SPELLINGS[what]:
        if key in arrays:
            return key
    found = ", ".join(sorted(arrays)) or "no array"
    raise VislamError(
        f"{path}: has no {what}: give it as {' or '.join(SPELLINGS[what])}; it holds {found}"
    )


def _stamps(
    path: Path, arrays: Arrays, key: str, mending: Mending
) -> tuple[NDArray[np.int64], Finding | None]:
    """Stamps, and what was wrong with them where they are mended."""
    values = finite(path, arrays, key)
    if not values.size or values.size != max(values.shape, default=0):
        raise wrong_shape(path, key, values.shape, "(T,) or (1, T) with at least one step")
    seconds = values.ravel()
    if seconds.min() < 0 or seconds.max() > LATEST_SECOND:
        raise VislamError(
            f"{path}: {key} goes from {seconds.min():g} to {seconds.max():g}: give UNIX seconds"
        )
    stamps, finding = nanoseconds(seconds), None
    if mending.mends_stamps:
        stamps, finding = mended_stamps(stamps)
    (late,) = np.nonzero(np.diff(stamps) <= 0)
    if len(late):
        k = int(late[0])
        stored = arrays[key]().dtype
        advice = ""
        if stored.kind == "f" and stored.itemsize < _SECONDS.itemsize:
            advice = f"; {stored.name} rounds such times: store them as {_SECONDS.name}"
        raise VislamError(
            f"{path}: {key}[{k + 1}] is {seconds[k + 1]!s}, not later than {seconds[k]!s} before "
            f"it: time must increase{advice}"
        )
    GAP.require(np.diff(stamps) / NANOSECONDS, f"{path}: {key}")
    return stamps, finding


def _linear_velocity(path: Path, arrays: Arrays, steps: int) -> tuple[Array, list[str]]:
    """Read the velocity (T, 3), NaN where it was not measured, and notes."""
    key = next((key for key in LINEAR_VELOCITY if key in arrays), None)
    if key is None:
        return np.full((steps, 3), np.nan), [NO_VELOCITY]
    values = _velocity(path, arrays, key, steps, VELOCITY)
    return values, [ALL_NAN] if np.isnan(values).all() else []


def _velocity(path: Path, arrays: Arrays, key: str, steps: int, meant: Range) -> Array:
    """Read a velocity (T, 3) that is stored as (3, T) or, unless T is 3 too, as (T, 3)."""
    values = finite(path, arrays, key, may_be_nan=True)
    meant.require(values[~np.isnan(values)], f"{path}: {key}")
    if values.shape == (3, steps):
        return values.T
    if values.shape == (steps, 3):
        return values
    raise wrong_shape(
        path, key, values.shape, f"(3, {steps}) or ({steps}, 3), one for each time stamp"
    )


def _features(
    path: Path, arrays: Arrays, steps: int, progress: Progress | None
) -> tuple[DenseFeatures, list[str]]:
    """Observations, and notes on how they were found."""
    if FEATURES not in arrays:
        return no_features(steps), [NO_FEATURES]
    shape = arrays[FEATURES]().shape
    axes, notes = _axes(path, shape, steps), []
    if axes != (0, 1, 2):
        names = ", ".join(name for _, name in sorted(zip(axes, ("4", "M", "T"), strict=True)))
        notes.append(f"Read {FEATURES} of shape {shape} as ({names}).")
    if shape[axes[1]] > np.iinfo(np.uint32).max:
        raise wrong_shape(path, FEATURES, shape, "of at most 4294967295 tracks")
    features = gather_observations(arrays[FEATURES], progress, axes=axes)
    if features.empty and not len(features.ids):
        raise VislamError(
            f"{path}: {FEATURES} holds zeros alone: write the observations into it, -1 -1 -1 -1 "
            "where there is none"
        )
    if features.empty:
        entries = shape[axes[1]] * steps
        share = features.empty / entries
        notes.append(
            f"{features.empty} of {entries} entries of {FEATURES} ({share:.1%}) are 0 0 0 0: "
            "read as unobserved, which is -1 -1 -1 -1."
        )
    return features, notes


def _axes(path: Path, shape: tuple[int, ...], steps: int) -> Axes:
    """Which axis of the features is (component, track, step)."""
    wanted = f"(4, M, {steps}), one step for each time stamp"
    if len(shape) != 3:
        raise wrong_shape(path, FEATURES, shape, wanted)
    fitting = [
        axes for axes in permutations(range(3)) if (shape[axes[0]], shape[axes[2]]) == (4, steps)
    ]
    if not fitting:
        raise wrong_shape(path, FEATURES, shape, wanted)
    documented = (0, 1, 2)
    if len(fitting) > 1 and documented not in fitting:
        raise VislamError(
            f"{path}: {FEATURES} has shape {shape}, and which axis is which cannot be told: give "
            f"it as {wanted}"
        )
    return documented if documented in fitting else cast(Axes, fitting[0])


def _ground_truth(path: Path, arrays: Arrays, stamps: NDArray[np.int64]) -> Trajectory:
    T_world_body = finite(path, arrays, GROUND_TRUTH)
    if T_world_body.shape != (len(stamps), 4, 4):
        raise wrong_shape(path, GROUND_TRUTH, T_world_body.shape, f"({len(stamps)}, 4, 4)")
    POSITION.require(T_world_body, f"{path}: {GROUND_TRUTH}")
    return Trajectory.from_matrices(stamps, T_world_body)
