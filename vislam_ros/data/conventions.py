# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which axes a file's twists have and which step each belongs to, measured in its images.

Files mix forward-left-up (FLU, as REP-103 wants) with forward-right-down (FRD) axes, in the twist
or in the extrinsics, and do not say whether a twist holds before or after its time stamp. A wrong
choice shows at once: points triangulated in one frame, moved by the twist of one step, miss where
the next frame sees them.
"""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core import se3
from vislam_ros.core.camera import StereoCamera
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
IMU_FRAMES = ("auto", "flu", "frd", "as-given")
TWIST_INDICES = ("auto", "end", "start")

# The half turn about the forward axis that takes FLU to FRD and back.
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
_HALF_TURN_TWIST = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])

_AXES = {"flu": "forward-left-up", "frd": "forward-right-down", "as-given": "as given"}

_STEPS_LOOKED_AT = 240  # about 200 once frozen ones are left out
_MIN_RESIDUALS = 20
_MIN_DISPARITY = 2.0  # pixels
_MIN_DEPTH = 0.1  # metres
# What the file says, twists at the end of their step, gives way only to a clearly smaller error.
_CLEARLY_SMALLER = 0.9


@dataclass(frozen=True)
class StepPairs:
    """Landmarks seen at both ends of a step.

    Attributes
    ----------
    steps : ndarray of int64, (n,)
        ``k`` of the step from ``k`` to ``k + 1``.
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)`` at ``k``, pixels.
    left : ndarray, (n, 2)
        ``u_left, v_left`` at ``k + 1``, pixels.
    """

    steps: NDArray[np.int64]
    y: Array
    left: Array


def settle_conventions(drive: Drive, *, imu_frame: str, twist_index: str) -> Drive:
    """Bring a drive as its file gives it to FLU axes and to twists at the end of their step.

    Parameters
    ----------
    drive : Drive
        With a twist for each feature frame, of the same stamps.
    imu_frame : {"auto", "flu", "frd", "as-given"}
        Axes of the twist. Extrinsics with other axes are turned to agree, then all to FLU;
        "as-given" leaves both alone.
    twist_index : {"auto", "end", "start"}
        Whether the step from ``k`` to ``k + 1`` has ``twist[k + 1]`` or ``twist[k]``.

    Returns
    -------
    Drive
        With notes on what was measured and done.

    Raises
    ------
    VislamError
        Where one of the two is not in :data:`IMU_FRAMES` or :data:`TWIST_INDICES`.
    """
    for what, value, choices in (
        ("imu_frame", imu_frame, IMU_FRAMES),
        ("twist_index", twist_index, TWIST_INDICES),
    ):
        if value not in choices:
            raise VislamError(f"{what} is {value!r}: choose one of {', '.join(choices)}")
    own_frame = extrinsics_frame(drive.camera)
    frames = [imu_frame]
    if imu_frame == "auto":
        frames = [own_frame, "frd" if own_frame == "flu" else "flu"]
    indices = ["end", "start"] if twist_index == "auto" else [twist_index]
    # In the order of preference: the first is what the file says.
    candidates = [(frame, index) for index in indices for frame in frames]
    if len(candidates) == 1:
        return _apply(drive, *candidates[0])

    pairs = step_pairs(drive)
    trials = [_apply(drive, *candidate) for candidate in candidates]
    errors = [reprojection_errors(trial, pairs) for trial in trials]
    if min(len(part) for part in errors) < _MIN_RESIDUALS:
        return _add_note(
            _apply(drive, "as-given" if imu_frame == "auto" else imu_frame, indices[0]),
            "Too few landmarks to tell the axes and the steps of the twists: taken as the file "
            f"gives them, each twist at the {indices[0]} of its step.",
        )
    medians = [float(np.median(part)) for part in errors]
    best = int(np.argmin(medians))
    if medians[best] > _CLEARLY_SMALLER * medians[0]:
        best = 0
    others = ", ".join(
        f"{medians[i]:.2f} px {_describe(*candidates[i])}"
        for i in range(len(candidates))
        if i != best
    )
    return _add_note(
        trials[best],
        f"Median one-step reprojection error {medians[best]:.2f} px with twists "
        f"{_describe(*candidates[best])} (others: {others}).",
    )


def extrinsics_frame(camera: StereoCamera) -> Literal["flu", "frd"]:
    """Axes of a body whose camera stands upright: the image's y axis points down in it."""
    return "flu" if camera.T_body_camera[2, 1] < 0 else "frd"


def step_pairs(drive: Drive) -> StepPairs:
    """Collect the common landmarks of evenly spaced steps that are not frozen."""
    looked_at = np.unique(np.linspace(0, drive.steps - 2, _STEPS_LOOKED_AT).astype(int))
    looked_at = looked_at[(looked_at >= 0) & (looked_at < drive.steps - 1)]
    steps, y, left = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))], [np.empty((0, 2))]
    for k in looked_at:
        ids_before, before = drive.frame(k)
        ids_after, after = drive.frame(k + 1)
        _, rows_before, rows_after = np.intersect1d(
            ids_before, ids_after, assume_unique=True, return_indices=True
        )
        z, z_after = before[rows_before].astype(float), after[rows_after].astype(float)
        if 2 * np.sum(np.all(z == z_after, axis=1)) > len(z):
            continue
        near = z[:, 0] - z[:, 2] > _MIN_DISPARITY
        z, z_after = z[near], z_after[near]
        steps.append(np.full(len(z), k))
        y.append(np.column_stack([z[:, 0], z[:, 2], (z[:, 1] + z[:, 3]) / 2]))
        left.append(z_after[:, :2])
    return StepPairs(np.concatenate(steps), np.concatenate(y), np.concatenate(left))


def reprojection_errors(drive: Drive, pairs: StepPairs) -> Array:
    """Pixels, (m,), between where a step's twist moves each landmark and where it is seen.

    ``|pi(T_cb Exp(-tau u) T_bc pi^-1(y_k)) - z_{k+1}|`` in the left image; landmarks that would
    end behind the camera are left out.
    """
    camera = drive.camera
    tau = np.diff(drive.twist_stamps) / NANOSECONDS
    T_after_before = (
        camera.T_camera_body @ se3.exp(-tau[:, None] * drive.twists[1:]) @ camera.T_body_camera
    )[pairs.steps]
    points = camera.triangulate(pairs.y)
    moved = (T_after_before[:, :3, :3] @ points[..., None])[..., 0] + T_after_before[:, :3, 3]
    ahead = moved[:, 2] > _MIN_DEPTH
    projected = camera.project(moved[ahead])
    return np.asarray(np.linalg.norm(projected[:, [0, 2]] - pairs.left[ahead], axis=1))


def _apply(drive: Drive, frame: str, index: str) -> Drive:
    """Bring a drive whose twists have these axes and this step to the package's convention."""
    if index == "start":
        # The first twist carries no step; the last one's step has no end.
        drive = _add_note(
            dataclasses.replace(
                drive, twists=np.concatenate([drive.twists[:1], drive.twists[:-1]])
            ),
            "Moved each twist from the start of its step to the end.",
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
        return _add_note(
            drive,
            f"The twists are {_AXES[frame]} and the extrinsics {_AXES[own_frame]}: turned the "
            f"{turned} by half a turn about the forward axis.",
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
