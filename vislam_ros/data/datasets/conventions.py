# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which axes a file's twists have, which step and which point each belongs to.

Files mix forward-left-up (FLU, as REP-103 wants) with forward-right-down (FRD) axes, in the twist
or in the extrinsics, and do not say whether a twist holds before or after its time stamp. A wrong
choice shows at once in the images: points triangulated in one frame, moved by the twist of one
step, miss where the next frame sees them. And some files' twists are those of another point than
the body that their extrinsics describe (see twist_origin).

Where all choices fit far worse than no motion at all, something else is wrong, and nothing is
mended on top of it: the drive is taken as the file has it.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets.fitted_translation import fitted_translations
from vislam_ros.data.datasets.step_pairs import StepPairs, step_pairs
from vislam_ros.data.datasets.twist_origin import (
    is_nearer,
    measure_twist_origin,
    misplaced_imu,
    moved_to_the_body,
)
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
IMU_FRAMES = ("auto", "flu", "frd", "as-given")
TWIST_INDICES = ("auto", "end", "start")
TWIST_ORIGINS = ("auto", "body", "imu")
EXTRINSICS = ("auto", "imu-to-optical", "flu-to-imu", "optical-to-imu", "imu-to-flu")

# The half turn about the forward axis that takes FLU to FRD and back.
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
_HALF_TURN_TWIST = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])

_AXES = {"flu": "forward-left-up", "frd": "forward-right-down", "as-given": "as given"}

#: Of fewer residuals nothing is told.
MIN_RESIDUALS = 20
_MIN_DEPTH = 0.1  # metres
#: What a file says, or what is usual, gives way only to an error that is smaller by this factor.
CLEARLY_SMALLER = 0.9
# Errors by those of a body that stands: from here on the twists are contradicted, and from here on
# it may be their unit.
_CONTRADICTED, _FAR = 1.5, 4.0
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class Conventions:
    """What a file's numbers mean; "auto" finds it in the images.

    Attributes
    ----------
    imu_frame : {"auto", "flu", "frd", "as-given"}
        Axes of the twist: forward-left-up, forward-right-down, or no look at them at all.
    twist_index : {"auto", "end", "start"}
        Whether the step from ``k`` to ``k + 1`` has ``twist[k + 1]`` or ``twist[k]``.
    twist_origin : {"auto", "body", "imu"}
        Whether the twists are those of the body that the extrinsics describe, or of an IMU from
        whose place their translation was made by turning it the wrong way (see twist_origin).

    Raises
    ------
    VislamError
        Where one is none of its choices.
    """

    imu_frame: str = "auto"
    twist_index: str = "auto"
    twist_origin: str = "auto"
    extrinsics: str = "auto"

    def __post_init__(self) -> None:
        choices: dict[str, Sequence[str]] = {
            "imu_frame": IMU_FRAMES,
            "twist_index": TWIST_INDICES,
            "twist_origin": TWIST_ORIGINS,
            "extrinsics": EXTRINSICS,
        }
        for what, value in vars(self).items():
            if value not in choices[what]:
                one_of = ", ".join(choices[what])
                raise VislamError(f"{what} is {value!r}: choose one of {one_of}")


#: The figure of a finding that the angular velocity is in degrees a second.
DEGREES = "reprojection_px_of_degrees"

#: Whatever fits the images.
AS_FOUND = Conventions()


def settle_conventions(drive: Drive, conventions: Conventions) -> Drive:
    """Bring a drive as its file gives it to FLU axes and the body's twists at their steps' ends.

    Parameters
    ----------
    drive : Drive
        With a twist for each feature frame, of the same stamps.
    conventions : Conventions
        Extrinsics with other axes than the twist's are turned to agree, then all to FLU.

    Returns
    -------
    Drive
        With notes on what was measured and done.
    """
    settled, fits = _settle_axes_and_steps(drive, conventions.imu_frame, conventions.twist_index)
    if not fits and conventions.twist_origin == "auto":
        return settled
    return _settle_origin(settled, drive.camera, conventions.twist_origin)


def _settle_origin(drive: Drive, camera_as_given: StereoCamera, twist_origin: str) -> Drive:
    """Move the twists to the body where they are those of a misplaced IMU."""
    if twist_origin == "body" or not drive.measures_velocity:
        return drive
    imu = misplaced_imu(camera_as_given)
    if drive.camera != camera_as_given:
        imu = imu * _HALF_TURN_TWIST[:3]
    numbers = {"imu_m": imu.tolist()}
    if twist_origin == "auto":
        measured = measure_twist_origin(drive)
        if measured is None or not is_nearer(measured, imu):
            return drive
        numbers["seen_m"] = measured.place.tolist()
        numbers["std_m"] = np.sqrt(np.diag(measured.covariance)).tolist()
    return dataclasses.replace(drive, twists=moved_to_the_body(drive, imu)).with_finding(
        Finding(
            "twist_origin",
            f"the twists are those of an IMU {np.linalg.norm(imu):.1f} m from the body of the "
            "extrinsics",
            "moved to the body",
            True,
            numbers,
        )
    )


def _settle_axes_and_steps(drive: Drive, imu_frame: str, twist_index: str) -> tuple[Drive, bool]:
    """Drive with axes and steps as they fit best, and whether they are not contradicted."""
    own_frame = extrinsics_frame(drive.camera)
    frames = [imu_frame]
    if imu_frame == "auto":
        frames = [own_frame, "frd" if own_frame == "flu" else "flu"]
    indices = ["end", "start"] if twist_index == "auto" else [twist_index]
    # In the order of preference: the first is what the file says.
    candidates = [(frame, index) for index in indices for frame in frames]
    if len(candidates) == 1:
        return _apply(drive, *candidates[0]), True

    as_stored = "as-given" if imu_frame == "auto" else imu_frame
    pairs = step_pairs(drive)
    trials = [_apply(drive, *candidate) for candidate in candidates]
    errors = [reprojection_errors(trial, pairs) for trial in trials]
    if min(len(part) for part in errors) < MIN_RESIDUALS:
        words = (
            "Too few landmarks to tell axes and steps of the twists: taken as the file has them."
        )
        return _add_note(_apply(drive, as_stored, indices[0]), words), True
    medians, best = _fitting_best(errors)
    still = float(np.median(reprojection_errors(_standing(drive), pairs)))
    if medians[best] > _FAR * still:
        as_radians = [reprojection_errors(in_radians(trial), pairs) for trial in trials]
        of_radians, fitting = _fitting_best(as_radians)
        if of_radians[fitting] < still:
            finding = _in_degrees(medians[fitting], of_radians[fitting])
            return trials[fitting].with_finding(finding), False
    if medians[best] > _CONTRADICTED * still:
        return _apply(drive, as_stored, indices[0]), False
    errors_px = {_describe(*each): error for each, error in zip(candidates, medians, strict=True)}
    findings = tuple(
        dataclasses.replace(each, numbers={**each.numbers, "reprojection_px": errors_px})
        if each.name in ("imu_frame", "twist_index")
        else each
        for each in trials[best].findings
    )
    return dataclasses.replace(trials[best], findings=findings), True


def _fitting_best(errors: Sequence[Array]) -> tuple[list[float], int]:
    """Median of each choice's errors, and which is best: the first unless one is clearly so."""
    medians = [float(np.median(part)) for part in errors]
    best = int(np.argmin(medians))
    return medians, 0 if medians[best] > CLEARLY_SMALLER * medians[0] else best


def _standing(drive: Drive) -> Drive:
    """Drive whose body does not move, as far as its motion is measured."""
    return dataclasses.replace(drive, twists=0.0 * drive.twists)


def in_radians(drive: Drive) -> Drive:
    """Drive whose angular velocity was in degrees a second."""
    return dataclasses.replace(drive, twists=drive.twists / np.repeat([1.0, _DEGREES], 3))


def is_in_degrees(drive: Drive) -> bool:
    """Whether reading found a drive's angular velocity to be in degrees a second."""
    return any(DEGREES in each.numbers for each in drive.findings)


def _in_degrees(as_given: float, as_radians: float) -> Finding:
    return Finding(
        "contradiction",
        f"the angular velocity is {_DEGREES:.1f} times what the images tell, as if in degrees: "
        f"they are off by {as_given:.1f} px a step, and by {as_radians:.1f} px if it is",
        "give radians a second",
        False,
        {DEGREES: as_radians, "reprojection_px": as_given},
    )


def extrinsics_frame(camera: StereoCamera) -> Literal["flu", "frd"]:
    """Axes of a body whose camera stands upright: the image's y axis points down in it."""
    return "flu" if camera.T_body_camera[2, 1] < 0 else "frd"


def reprojection_errors(drive: Drive, pairs: StepPairs) -> Array:
    """Pixels, (m,), between where a step's twist moves each landmark and where it is seen.

    ``|pi(T_cb Exp(-tau u) T_bc pi^-1(y_k)) - z_{k+1}|`` in the left image; landmarks that would
    end behind the camera are left out. Where no velocity is measured, it is the one of each step
    that fits best.
    """
    camera = drive.camera
    tau = np.diff(drive.twist_stamps) / NANOSECONDS
    motion = se3.exp(-tau[:, None] * np.nan_to_num(drive.twists[1:]))
    T_after_before = (camera.T_camera_body @ motion @ camera.T_body_camera)[pairs.steps]
    points = camera.triangulate(pairs.y)
    moved = (T_after_before[:, :3, :3] @ points[..., None])[..., 0]
    if drive.measures_velocity:
        moved += T_after_before[:, :3, 3]
    else:
        moved += fitted_translations(camera, pairs.steps, moved, pairs.left)
    ahead = moved[:, 2] > _MIN_DEPTH
    projected = camera.project(moved[ahead])
    return np.asarray(np.linalg.norm(projected[:, [0, 2]] - pairs.left[ahead], axis=1))


def _apply(drive: Drive, frame: str, index: str) -> Drive:
    """Bring a drive whose twists have these axes and this step to the package's convention."""
    if index == "start":
        # The first twist carries no step; the last one's step has no end.
        drive = dataclasses.replace(
            drive, twists=np.concatenate([drive.twists[:1], drive.twists[:-1]])
        ).with_finding(
            Finding(
                "twist_index",
                "twists are those of the step that begins at their stamp",
                "moved to its end",
                True,
            )
        )
    if frame == "as-given":
        return drive
    own_frame = extrinsics_frame(drive.camera)
    if own_frame == "frd":
        drive = dataclasses.replace(drive, camera=_half_turn(drive.camera))
    if frame == "frd":
        truth = drive.ground_truth
        if truth is not None:
            truth = Trajectory.from_matrices(
                truth.stamps, _HALF_TURN @ truth.T_world_body @ _HALF_TURN
            )
        drive = dataclasses.replace(
            drive, twists=drive.twists * _HALF_TURN_TWIST, ground_truth=truth
        )
    if own_frame != frame:
        turned = "extrinsics" if own_frame == "frd" else "twists"
        return drive.with_finding(
            Finding(
                "imu_frame",
                f"the twists are {_AXES[frame]}, the extrinsics {_AXES[own_frame]}",
                f"turned the {turned}",
                True,
                {"twists": frame, "extrinsics": own_frame},
            )
        )
    if frame == "frd":
        return _add_note(
            drive, f"Turned twists and extrinsics from {_AXES['frd']} to {_AXES['flu']} axes."
        )
    return drive


def _half_turn(camera: StereoCamera) -> StereoCamera:
    """Turn the body's axes by half a turn about the first, without rounding."""
    x, y, z = camera.position_body_camera
    qx, qy, qz, qw = camera.quaternion_body_camera
    sign = -1.0 if qx > 0 else 1.0  # keeps the real part, -qx, from being negative
    return dataclasses.replace(
        camera,
        position_body_camera=(x, -y, -z),
        quaternion_body_camera=(sign * qw, sign * -qz, sign * qy, sign * -qx),
    )


def _describe(frame: str, index: str) -> str:
    return f"{_AXES[frame]} at the {index} of their step"


def _add_note(drive: Drive, note: str) -> Drive:
    return dataclasses.replace(drive, notes=(*drive.notes, note))
