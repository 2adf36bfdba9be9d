# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the arrays of a dataset say of its cameras, in every reading that makes a stereo pair."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import (
    Intrinsics,
    NoStereoPairError,
    PixelRectification,
    rectified_pair,
)
from vislam_ros.core.ranges import BASELINE, FOCAL_LENGTH, MOUNT, PRINCIPAL_POINT
from vislam_ros.data.datasets.arrays.array_stream import Arrays
from vislam_ros.data.datasets.conventions import CLEARLY_SMALLER, MIN_RESIDUALS
from vislam_ros.data.datasets.extrinsics import READINGS
from vislam_ros.data.datasets.members import finite, wrong_shape
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# Stored rotations are orthonormal to about 1e-8, and a matrix that is no rotation is far off.
_ROTATION_TOLERANCE = 1e-3

LEFT, RIGHT, RIGHT_INTRINSICS = "extL_T_imu", "extR_T_imu", "K_r"


class ReadPair(NamedTuple):
    """A stereo pair as a dataset has it in one reading.

    Attributes
    ----------
    reading : str
        In words; empty where the names of the arrays leave no choice.
    camera : StereoCamera
    rectification : PixelRectification or None
        What its pixels go through.
    notes : tuple of str
        What that is.
    complaint : str
        Why the two are no stereo pair, as if they stood side by side; empty where they are one.
    """

    reading: str
    camera: StereoCamera
    rectification: PixelRectification | None
    notes: tuple[str, ...]
    complaint: str = ""


class PairReading(NamedTuple):
    """A reading, with the cameras turned as it says and, where that matters, as they stand."""

    turned: ReadPair
    unturned: ReadPair | None

    def unnamed(self) -> "PairReading":
        """Without the reading's name, where there was no choice."""
        unturned = None if self.unturned is None else self.unturned._replace(reading="")
        return PairReading(self.turned._replace(reading=""), unturned)

    def fitting(self, pixels: Array) -> ReadPair:
        """Choose by observations (n, 4): in a rectified pair both see a point in the same row.

        Poses of a calibration may go with images that were rectified afterwards.
        """
        if self.unturned is None or len(pixels) < MIN_RESIDUALS:
            return self.turned
        turned, unturned = (_row_error(pair, pixels) for pair in (self.turned, self.unturned))
        if unturned > CLEARLY_SMALLER * turned:
            return self.turned
        note = (
            f"Did not turn the cameras as {LEFT} and {RIGHT} say: their rows differ by "
            f"{unturned:.2f} px as they are and by {turned:.2f} px turned."
        )
        return self.unturned._replace(notes=(*self.unturned.notes, note))


def read_pairs(path: Path, arrays: Arrays, keys: dict[str, str], chosen: str) -> list[PairReading]:
    """Read the cameras of a dataset.

    Parameters
    ----------
    path : Path
        For errors.
    arrays : dict
        Of the dataset.
    keys : dict of str to str
        Its keys for "intrinsics", "baseline" and "extrinsics".
    chosen : str
        A key of :data:`~vislam_ros.data.datasets.extrinsics.READINGS`, or "auto".

    Returns
    -------
    list of PairReading
        The most likely first: its baseline is nearest to the image's x axis. Those that are no
        stereo pair come last, for what the images say of them.

    Raises
    ------
    VislamError
        Where a member is wrong, or no reading makes a stereo pair.
    """
    left = intrinsics(path, arrays, keys["intrinsics"])
    right = left
    if keys["intrinsics"] == "K_l" and RIGHT_INTRINSICS in arrays:
        right = intrinsics(path, arrays, RIGHT_INTRINSICS)
    if keys["baseline"] == RIGHT and LEFT not in arrays:
        raise VislamError(f"{path}: {RIGHT} gives a baseline only beside {LEFT}")
    names = [*READINGS] if chosen == "auto" else [chosen]
    if LEFT not in (keys["extrinsics"], *([LEFT] if keys["baseline"] == RIGHT else [])):
        names = names[:1]
    mount = rigid_motion(path, arrays, keys["extrinsics"])
    baseline = None if keys["baseline"] == RIGHT else _baseline(path, arrays, keys["baseline"])
    found: list[tuple[float, PairReading]] = []
    for name in names:
        reading = READINGS[name]
        if baseline is None:
            T_left_right = reading.left_right(
                rigid_motion(path, arrays, LEFT), rigid_motion(path, arrays, RIGHT)
            )
        else:
            T_left_right = _beside(baseline)
        T_body_camera = mount
        if keys["extrinsics"] == LEFT:
            T_body_camera = reading.body_camera(mount)
        elif keys["extrinsics"] == "cam_T_imu":
            T_body_camera = se3.inverse(mount)
        pair = _pair(left, right, T_left_right, T_body_camera, reading.words)
        found.append((_off_axis(T_left_right), pair))
    found.sort(key=lambda each: (bool(each[1].turned.complaint), each[0]))
    first = found[0][1].turned
    if first.complaint:
        raise VislamError(f"{path}: {first.complaint}")
    BASELINE.require(first.camera.baseline, f"{path}: {keys['baseline']}")
    if len(found) == 1:
        return [found[0][1].unnamed()]
    return [pair for _, pair in found]


def _beside(baseline: float) -> Array:
    T_left_right = np.eye(4)
    T_left_right[0, 3] = baseline
    return T_left_right


def _off_axis(T_left_right: Array) -> float:
    """Sine of the angle between the baseline and the x axis, to what a calibration knows."""
    p = T_left_right[:3, 3]
    return round(float(np.linalg.norm(p[1:]) / np.linalg.norm(p)), 6)


def _pair(
    K_left: Array, K_right: Array, T_left_right: Array, T_body_camera: Array, words: str
) -> PairReading:
    left, right = Intrinsics.of_matrix(K_left), Intrinsics.of_matrix(K_right)
    distance = float(np.linalg.norm(T_left_right[:3, 3]))
    straight = rectified_pair(left, right, _beside(distance or 1.0))
    notes: tuple[str, ...] = ()
    if straight.pixels is not None:
        difference = np.abs(K_left - K_right).max()
        notes = (f"K_r differs from K_l by up to {difference:.3g} px: mapped its pixels to K_l.",)
    camera = StereoCamera.from_matrices(K_left, distance, T_body_camera)
    unturned = ReadPair(words, camera, straight.pixels, notes)
    try:
        rectified = rectified_pair(left, right, T_left_right)
    except NoStereoPairError as error:
        complaint = f"{LEFT} and {RIGHT} are no stereo pair: as {words} {error}"
        return PairReading(unturned._replace(complaint=complaint), None)
    if not rectified.turns:
        camera = StereoCamera.from_matrices(K_left, rectified.baseline, T_body_camera)
        return PairReading(ReadPair(words, camera, rectified.pixels, notes), None)
    if rectified.R_left_rectified is not None:
        T_body_camera = T_body_camera.copy()
        T_body_camera[:3, :3] = T_body_camera[:3, :3] @ rectified.R_left_rectified
    camera = StereoCamera.from_matrices(K_left, rectified.baseline, T_body_camera)
    angle = np.degrees(np.linalg.norm(se3.log_rotation(T_left_right[:3, :3])))
    turn = (
        f"Rectified the pixels: against the left camera the right one is turned by {angle:.2g} "
        f"degrees and stands {np.degrees(np.arcsin(_off_axis(T_left_right))):.2g} degrees off."
    )
    return PairReading(ReadPair(words, camera, rectified.pixels, (*notes, turn)), unturned)


def _row_error(pair: ReadPair, pixels: Array) -> float:
    """Median difference of the rows of both images, pixels."""
    if pair.rectification is not None:
        pixels = pair.rectification.pixels(pixels)
    with np.errstate(invalid="ignore"):
        return float(np.nanmedian(np.abs(pixels[:, 1] - pixels[:, 3])))


def intrinsics(path: Path, arrays: Arrays, key: str) -> Array:
    """Intrinsics (3, 3) of a pinhole camera without skew, pixels."""
    K = finite(path, arrays, key)
    if K.shape != (3, 3):
        raise wrong_shape(path, key, K.shape, "(3, 3)")
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


def rigid_motion(path: Path, arrays: Arrays, key: str) -> Array:
    """Pose (4, 4), metres."""
    T = finite(path, arrays, key)
    if T.shape != (4, 4):
        raise wrong_shape(path, key, T.shape, "(4, 4)")
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
    values = finite(path, arrays, key)
    if values.size != 1:
        raise wrong_shape(path, key, values.shape, "one number")
    baseline = float(values.item())
    if baseline <= 0:
        raise VislamError(f"{path}: {key} gives a baseline of {baseline} m: it must be positive")
    BASELINE.require(baseline, f"{path}: {key}")
    return baseline
