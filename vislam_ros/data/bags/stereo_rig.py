# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two cameras with their lenses, from both camera infos and where the left one is in the body."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import (
    DISTORTION_MODELS,
    RawCamera,
    StereoRig,
    without_idle_zeros,
)
from vislam_ros.core.ranges import FOCAL_LENGTH, PRINCIPAL_POINT
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, check_range
from vislam_ros.data.bags import decoding

Array = NDArray[np.float64]

_ROTATION_TOLERANCE = 1e-3
# Drivers that calibrate a fisheye write its name so; its model is the same.
_SAME_MODELS = {"fisheye": "equidistant", "none": "", "radtan": "plumb_bob"}


def stereo_rig(left: Any, right: Any, T_body_left: Array, *, rectified: bool) -> StereoRig:
    """Rig of two CameraInfo messages.

    With R the rotation of a message and b the baseline in its P, the right camera stands in the
    left one at ``R_left^T (R_right p + [b, 0, 0])``.

    Parameters
    ----------
    left, right : CameraInfo
    T_body_left : ndarray, (4, 4)
        Pose of the left optical frame in the body.
    rectified : bool
        Whether the images are rectified already: then P is all that counts.

    Raises
    ------
    RefusedMessage
        Where a message has no calibration, or both are no pair.
    """
    projections = decoding.projection(left), decoding.projection(right)
    P_left, P_right = (each.P for each in projections)
    baseline = (P_left[0, 3] - P_right[0, 3]) / P_right[0, 0]
    if baseline <= 0:
        raise RefusedMessage(
            Refusal.NOT_A_PAIR,
            f"field p[3] of the right camera is {P_right[0, 3]}: it must be -fx times the "
            "baseline",
        )
    T_between = np.eye(4)
    T_between[0, 3] = baseline
    if rectified:
        ours, theirs = (
            RawCamera(each.image_size, each.P[:, :3].copy(), "", np.zeros(0))
            for each in projections
        )
        return StereoRig(ours, theirs, T_between, T_body_left)
    T_left = se3.inverse(_turn(left))
    return StereoRig(
        _camera(left),
        _camera(right),
        T_left_right=T_left @ T_between @ _turn(right),
        T_body_left=T_body_left,
    )


def _camera(message: Any) -> RawCamera:
    K = np.array(message.k, dtype=np.float64).reshape(3, 3)
    D = np.array(message.d, dtype=np.float64)
    if not (np.all(np.isfinite(K)) and np.all(np.isfinite(D))):
        raise RefusedMessage(Refusal.NON_FINITE)
    check_range(FOCAL_LENGTH, [K[0, 0], K[1, 1]])
    check_range(PRINCIPAL_POINT, K[:2, 2])
    given = str(message.distortion_model)
    model = _SAME_MODELS.get(given, given)
    # Of the equidistant model, all zeros is a fisheye lens, not a pinhole.
    if not np.any(D) and model != "equidistant":
        model, D = "", np.zeros(0)
    if model not in DISTORTION_MODELS:
        raise RefusedMessage(
            Refusal.BAD_FIELDS,
            f"distortion_model is {given!r:.40}: calibrate it as one of "
            + ", ".join(filter(None, DISTORTION_MODELS)),
        )
    size = int(message.width), int(message.height)
    return RawCamera(size, K, model, without_idle_zeros(model, D))


def _turn(message: Any) -> Array:
    """Rotation of a camera into its rectified frame, as a pose (4, 4); none where it is zero."""
    R = np.array(message.r, dtype=np.float64).reshape(3, 3)
    T = np.eye(4)
    if not np.any(R):
        return T
    if not np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
        raise RefusedMessage(Refusal.BAD_FIELDS, "field r is no rotation")
    T[:3, :3] = se3.nearest_rotation(R)
    return T
