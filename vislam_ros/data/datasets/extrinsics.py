# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The four readings of ``extL_T_imu`` and ``extR_T_imu``, and which of them fits.

Course files do not say what these poses are: from the IMU to the camera or the other way, the
camera with optical axes or, as the IMU, x forward, y left and z up. Read wrongly they put the
right camera ahead of the left one, above it or to its left. What still makes a pair is told by
the images: points triangulated in one frame, moved by the twist, must meet the next frame.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.datasets.conventions import (
    CLEARLY_SMALLER,
    MIN_RESIDUALS,
    Conventions,
    reprojection_errors,
    settle_conventions,
)
from vislam_ros.data.datasets.step_pairs import step_pairs
from vislam_ros.data.drive import Drive
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# Metres and radians: what inverting a pose adds is smaller, so all readings of the same pair give
# the same bits, and what a file tells is larger.
_DECIMALS = 12

# Axes of an optical frame (x right, y down, z forward) in one with x forward, y left and z up.
_FORWARD_OPTICAL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


class Reading(NamedTuple):
    """What a pose of a file is.

    Attributes
    ----------
    words : str
    is_from_imu : bool
        Whether it maps the IMU's coordinates to the camera's.
    T_camera_optical : ndarray, (4, 4)
        Optical axes in those of the file's camera.
    """

    words: str
    is_from_imu: bool
    T_camera_optical: Array

    def body_camera(self, T: Array) -> Array:
        """Pose (4, 4) of the optical frame in the body."""
        # The inverse proper: a stored rotation is one to about 1e-8 only.
        T_body_file = np.linalg.inv(T) if self.is_from_imu else T
        T_body_camera = T_body_file @ self.T_camera_optical
        T_body_camera[:3, :3] = se3.nearest_rotation(T_body_camera[:3, :3])
        return np.round(T_body_camera, _DECIMALS)

    def left_right(self, T_left: Array, T_right: Array) -> Array:
        """Pose (4, 4) of the right optical frame in the left one."""
        T = se3.inverse(self.body_camera(T_left)) @ self.body_camera(T_right)
        return np.round(T, _DECIMALS)


#: By what ``--extrinsics`` calls them, in the order in which they are preferred.
READINGS = {
    "imu-to-optical": Reading("IMU to optical axes", True, np.eye(4)),
    "flu-to-imu": Reading("camera (x forward, y left, z up) to IMU", False, _FORWARD_OPTICAL),
    "optical-to-imu": Reading("optical axes to IMU", False, np.eye(4)),
    "imu-to-flu": Reading("IMU to camera (x forward, y left, z up)", True, _FORWARD_OPTICAL),
}


class Candidate(NamedTuple):
    """A drive with its extrinsics read in one way.

    Attributes
    ----------
    words : str
        What they are read as; empty where there is no choice.
    drive : Drive
    complaint : str
        Why they cannot be meant so; empty where they can.
    """

    words: str
    drive: Drive
    complaint: str = ""


def choose_reading(candidates: Sequence[Candidate], conventions: Conventions) -> tuple[int, Drive]:
    """Choose the reading whose drive fits its images best.

    Parameters
    ----------
    candidates : sequence of Candidate
        At least one, which can be meant; the most likely first. Another is taken where its error
        is clearly smaller.
    conventions : Conventions
        See :func:`~vislam_ros.data.datasets.conventions.settle_conventions`.

    Returns
    -------
    int, Drive
        Its place, and its drive as it was given, with a note on what was taken where the file
        leaves a choice.

    Raises
    ------
    VislamError
        Where the images fit only what cannot be meant: its complaint.
    """
    first = candidates[0]
    if not first.words:
        return 0, first.drive
    errors = [quick_error(each.drive, conventions) for each in candidates]
    best = int(np.argmin(errors))
    if not errors[best] < CLEARLY_SMALLER * errors[0]:
        best = 0
    if candidates[best].complaint:
        raise VislamError(candidates[best].complaint)
    others = [each for k, each in enumerate(candidates) if k != best and not each.complaint]
    if not others:
        reason = "no other reading makes a stereo pair"
    elif errors[best] < np.inf:
        reason = "it fits the images best"
    else:
        reason = "there are too few landmarks to tell it from the others"
    words, drive, _ = candidates[best]
    note = f"Read extL_T_imu as {words}: {reason}."
    return best, dataclasses.replace(drive, notes=(*drive.notes, note))


def quick_error(drive: Drive, conventions: Conventions) -> float:
    """One-step reprojection error, pixels; infinite where too few landmarks tell."""
    # The place of the IMU changes little here, and takes long to find.
    quick = dataclasses.replace(conventions, twist_origin="body")
    drive = settle_conventions(drive, quick)
    errors = reprojection_errors(drive, step_pairs(drive))
    return float(np.median(errors)) if len(errors) >= MIN_RESIDUALS else np.inf
