# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's format: dense arrays in an ``.npz`` file, or in a dict in an ``.npy`` file.

The format (M tracks, T steps), in every spelling in use; velocities may be transposed::

    features (4, M, T)   u_left, v_left, u_right, v_right in pixels; all four -1 where unseen
    time_stamps, timestamps (T,)                           UNIX seconds
    linear_velocity, v_t (3, T)                            metres a second, in the IMU's axes
    angular_velocity, rotational_velocity, w_t (3, T)      radians a second, in the IMU's axes
    K, K_l (3, 3)                                          intrinsics of both rectified cameras
    b, baseline                                            metres; or extL_T_imu and extR_T_imu
    imu_T_cam (camera to IMU); cam_T_imu, extL_T_imu (IMU to left camera) (4, 4)
    ground_truth_T_world_body (T, 4, 4)                    in simulated files
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.ranges import (
    BASELINE,
    FOCAL_LENGTH,
    GAP,
    LARGEST_PIXEL,
    MOUNT,
    POSITION,
    PRINCIPAL_POINT,
    TURN_RATE,
    VELOCITY,
    Range,
)
from vislam_ros.data.datasets.array_stream import Arrays, ArrayStream, open_arrays
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions, settle_conventions
from vislam_ros.data.datasets.sparse_features import Progress, gather_observations
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.trajectory import LATEST_SECOND, NANOSECONDS, Trajectory, nanoseconds
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

SPELLINGS = {
    "features": ("features",),
    "time stamps": ("time_stamps", "timestamps"),
    "linear velocity": ("linear_velocity", "v_t"),
    "angular velocity": ("angular_velocity", "rotational_velocity", "w_t"),
    "intrinsics": ("K", "K_l"),
    "baseline": ("b", "baseline", "extR_T_imu"),
    "extrinsics": ("imu_T_cam", "cam_T_imu", "extL_T_imu"),
}
GROUND_TRUTH = "ground_truth_T_world_body"
# Read together with another key, or known and of no use here.
_COMPANIONS = ("K_r", "extL_T_imu", "extR_T_imu", GROUND_TRUTH, "ground_truth_landmarks")

# Stored rotations are orthonormal to about 1e-8, and a matrix that is no rotation is far off.
_ROTATION_TOLERANCE = 1e-3
# A pair counts as rectified when its other offsets are below this share of the baseline.
_RECTIFIED_TOLERANCE = 0.05


def matches(path: Path) -> bool:
    """Whether a path looks like such a file, by its name."""
    return path.is_file() and path.suffix in (".npz", ".npy")


def read(
    path: Path,
    *,
    conventions: Conventions = AS_FOUND,
    progress: Progress | None = None,
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

    Returns
    -------
    Drive
        With what was repaired or left out in its notes.

    Raises
    ------
    VislamError
        Where the file cannot be read or is no dataset; the message names the field.
    """
    with open_arrays(path) as arrays:
        keys = {what: _find_key(path, arrays, what) for what in SPELLINGS}
        stamps = _stamps(path, arrays, keys["time stamps"])
        velocity = _velocity(path, arrays, keys["linear velocity"], len(stamps), VELOCITY)
        angular_velocity = _velocity(
            path, arrays, keys["angular velocity"], len(stamps), TURN_RATE
        )
        camera, notes = _camera(path, arrays, keys)
        truth = _ground_truth(path, arrays, stamps) if GROUND_TRUTH in arrays else None
        unknown = sorted(set(arrays) - set(keys.values()) - set(_COMPANIONS))
        features = gather_observations(
            _features(path, arrays, keys["features"], len(stamps)), progress
        )

    if unknown:
        notes.append(f"Ignored keys that are no part of the format: {', '.join(unknown)}.")
    if features.unusable:
        notes.append(
            f"Left out {features.unusable} observations with a pixel that is not finite or "
            f"beyond {LARGEST_PIXEL:.0f}."
        )
    drive = Drive(
        name=path.stem,
        camera=camera,
        image_size=image_size_that_holds(features.pixels),
        twist_stamps=stamps,
        twists=np.column_stack([velocity, angular_velocity]),
        feature_stamps=stamps,
        offsets=features.offsets,
        ids=features.ids,
        pixels=features.pixels,
        ground_truth=truth,
        notes=tuple(notes),
    )
    return settle_conventions(drive, conventions)


def _find_key(path: Path, arrays: Arrays, what: str) -> str:
    for key in SPELLINGS[what]:
        if key in arrays:
            return key
    found = ", ".join(sorted(arrays)) or "no array"
    raise VislamError(
        f"{path}: has no {what}: give it as {' or '.join(SPELLINGS[what])}; it holds {found}"
    )


def _finite(path: Path, arrays: Arrays, key: str) -> Array:
    values = arrays[key]().array()
    if not np.all(np.isfinite(values)):
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise VislamError(
            f"{path}: {key}{list(index)} is {values[index]}: every value must be finite"
        )
    return values


def _wrong_shape(path: Path, key: str, shape: tuple[int, ...], wanted: str) -> VislamError:
    return VislamError(f"{path}: {key} has shape {shape}, not {wanted}")


def _stamps(path: Path, arrays: Arrays, key: str) -> NDArray[np.int64]:
    values = _finite(path, arrays, key)
    if not values.size or values.size != max(values.shape, default=0):
        raise _wrong_shape(path, key, values.shape, "(T,) or (1, T) with at least one step")
    seconds = values.ravel()
    if seconds.min() < 0 or seconds.max() > LATEST_SECOND:
        raise VislamError(
            f"{path}: {key} goes from {seconds.min():g} to {seconds.max():g}: give UNIX seconds"
        )
    stamps = nanoseconds(seconds)
    (late,) = np.nonzero(np.diff(stamps) <= 0)
    if len(late):
        k = int(late[0])
        raise VislamError(
            f"{path}: {key}[{k + 1}] is {seconds[k + 1]!s}, not later than {seconds[k]!s} before "
            "it: time must increase"
        )
    GAP.require(np.diff(stamps) / NANOSECONDS, f"{path}: {key}")
    return stamps


def _velocity(path: Path, arrays: Arrays, key: str, steps: int, meant: Range) -> Array:
    """Read a velocity (T, 3) that is stored as (3, T) or, unless T is 3 too, as (T, 3)."""
    values = _finite(path, arrays, key)
    meant.require(values, f"{path}: {key}")
    if values.shape == (3, steps):
        return values.T
    if values.shape == (steps, 3):
        return values
    raise _wrong_shape(
        path, key, values.shape, f"(3, {steps}) or ({steps}, 3), one for each time stamp"
    )


def _features(path: Path, arrays: Arrays, key: str, steps: int) -> ArrayStream:
    stream = arrays[key]()
    shape = stream.shape
    if len(shape) != 3 or shape[0] != 4 or shape[2] != steps:
        raise _wrong_shape(path, key, shape, f"(4, M, {steps}), one step for each time stamp")
    if shape[1] > np.iinfo(np.uint32).max:
        raise _wrong_shape(path, key, shape, "of at most 4294967295 tracks")
    return stream


def _camera(path: Path, arrays: Arrays, keys: dict[str, str]) -> tuple[StereoCamera, list[str]]:
    K = _intrinsics(path, arrays, keys["intrinsics"])
    notes = []
    if keys["intrinsics"] == "K_l" and "K_r" in arrays:
        difference = np.abs(_intrinsics(path, arrays, "K_r") - K).max()
        if difference > 0:
            notes.append(f"K_r differs from K_l by up to {difference:.3g} px: K_l is used.")
    key = keys["extrinsics"]
    T = _rigid_motion(path, arrays, key)
    return StereoCamera.from_matrices(
        K,
        _baseline(path, arrays, keys["baseline"]),
        T if key == "imu_T_cam" else se3.inverse(T),
    ), notes


def _intrinsics(path: Path, arrays: Arrays, key: str) -> Array:
    K = _finite(path, arrays, key)
    if K.shape != (3, 3):
        raise _wrong_shape(path, key, K.shape, "(3, 3)")
    focal_lengths = np.diag(K)[:2]
    rest = K - np.diag([*focal_lengths, 1.0])
    rest[:2, 2] = 0.0
    if np.any(focal_lengths <= 0) or np.any(np.abs(rest) > 1e-6 * focal_lengths.max()):
        raise VislamError(
            f"{path}: {key} is {K.tolist()}: intrinsics of a rectified camera are "
            "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy positive"
        )
    FOCAL_LENGTH.require(focal_lengths, f"{path}: {key}")
    PRINCIPAL_POINT.require(K[:2, 2], f"{path}: {key}")
    return K


def _rigid_motion(path: Path, arrays: Arrays, key: str) -> Array:
    T = _finite(path, arrays, key)
    if T.shape != (4, 4):
        raise _wrong_shape(path, key, T.shape, "(4, 4)")
    R = T[:3, :3]
    if (
        not np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_TOLERANCE)
        or np.linalg.det(R) < 0
        or not np.allclose(T[3], [0, 0, 0, 1])
    ):
        raise VislamError(
            f"{path}: {key} is {T.tolist()}: no rigid motion [[R, p], [0, 1]] with a rotation R"
        )
    MOUNT.require(T[:3, 3], f"{path}: {key}")
    return T


def _baseline(path: Path, arrays: Arrays, key: str) -> float:
    if key == "extR_T_imu":
        if "extL_T_imu" not in arrays:
            raise VislamError(f"{path}: extR_T_imu gives a baseline only beside extL_T_imu")
        T_left_right = _rigid_motion(path, arrays, "extL_T_imu") @ se3.inverse(
            _rigid_motion(path, arrays, key)
        )
        baseline, *offsets = T_left_right[:3, 3].tolist()
        angle = float(np.linalg.norm(se3.log_rotation(se3.nearest_rotation(T_left_right[:3, :3]))))
        if max(*np.abs(offsets), angle * abs(baseline)) > _RECTIFIED_TOLERANCE * abs(baseline):
            raise VislamError(
                f"{path}: extL_T_imu and extR_T_imu are no rectified pair: the right camera lies "
                f"at {T_left_right[:3, 3].tolist()} m in the left one, turned by {angle:.3g} rad"
            )
    else:
        values = _finite(path, arrays, key)
        if values.size != 1:
            raise _wrong_shape(path, key, values.shape, "one number")
        baseline = float(values.item())
    if baseline <= 0:
        raise VislamError(f"{path}: {key} gives a baseline of {baseline} m: it must be positive")
    BASELINE.require(baseline, f"{path}: {key}")
    return baseline


def _ground_truth(path: Path, arrays: Arrays, stamps: NDArray[np.int64]) -> Trajectory:
    T_world_body = _finite(path, arrays, GROUND_TRUTH)
    if T_world_body.shape != (len(stamps), 4, 4):
        raise _wrong_shape(path, GROUND_TRUTH, T_world_body.shape, f"({len(stamps)}, 4, 4)")
    POSITION.require(T_world_body, f"{path}: {GROUND_TRUTH}")
    return Trajectory.from_matrices(stamps, T_world_body)
