# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrations beside images: ``sensor.yaml`` of the ASL format, ``camchain.yaml`` of Kalibr."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import COEFFICIENTS, RawCamera
from vislam_ros.core.ranges import FOCAL_LENGTH, MOUNT, PRINCIPAL_POINT
from vislam_ros.data.files.inputs import read_text
from vislam_ros.data.files.parameter_file import parse_yaml
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_WHAT = "this calibration"
_LARGEST = 1 << 17
# OpenCV's YAML begins with a line and has tags that YAML does not know.
_OF_OPENCV = re.compile(r"\A%YAML:[^\n]*\n|!!opencv-matrix")
_ROTATION_TOLERANCE = 1e-3
_MODELS = {
    "": "",
    "none": "",
    "radtan": "plumb_bob",
    "radial-tangential": "plumb_bob",
    "plumb_bob": "plumb_bob",
    "equi": "equidistant",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "rational_polynomial": "rational_polynomial",
}


class CameraOnBody(NamedTuple):
    """A camera, and its pose (4, 4) in the body; its size is 0 x 0 where it is not told."""

    camera: RawCamera
    T_body_camera: Array


def read_sensor_pose(path: Path) -> Array:
    """Pose ``T_BS`` (4, 4) of a sensor in the body, from its ``sensor.yaml``.

    Raises
    ------
    VislamError
        Naming the file and the field.
    """
    return _pose(path, "T_BS", _mapping(path, _content(path)).get("T_BS"))


def read_camera(path: Path) -> CameraOnBody:
    """Read the camera of a ``sensor.yaml``; errors as :func:`read_sensor_pose`."""
    fields = _mapping(path, _content(path))
    camera = _camera(path, fields, "", "distortion_coefficients")
    return CameraOnBody(camera, _pose(path, "T_BS", fields.get("T_BS")))


def read_camchain(path: Path, camera: str) -> CameraOnBody:
    """Read a camera of a ``camchain.yaml``, such as ``cam0``; its body is the IMU."""
    fields = _mapping(path, _mapping(path, _content(path)).get(camera), f"{camera}.")
    T_camera_imu = _pose(path, f"{camera}.T_cam_imu", fields.get("T_cam_imu"))
    return CameraOnBody(
        _camera(path, fields, f"{camera}.", "distortion_coeffs"), se3.inverse(T_camera_imu)
    )


def _content(path: Path) -> Any:
    return parse_yaml(_OF_OPENCV.sub("", read_text(path, _WHAT, _LARGEST)), str(path))


def _mapping(path: Path, content: Any, prefix: str = "") -> Mapping[str, Any]:
    if not isinstance(content, dict):
        where = prefix.rstrip(".") or "it"
        raise VislamError(f"{path}: cannot read {_WHAT}: {where} holds no fields")
    return content


def _camera(path: Path, fields: Mapping[str, Any], prefix: str, coefficients: str) -> RawCamera:
    model = str(fields.get("camera_model", "pinhole"))
    if model.lower() != "pinhole":
        raise VislamError(f"{path}: {prefix}camera_model is {model!r}: calibrate it as a pinhole")
    fx, fy, cx, cy = _numbers(path, f"{prefix}intrinsics", fields.get("intrinsics"), (4,))
    FOCAL_LENGTH.require([fx, fy], f"{path}: {prefix}intrinsics")
    PRINCIPAL_POINT.require([cx, cy], f"{path}: {prefix}intrinsics")
    size = (0, 0)
    if "resolution" in fields:
        width, height = _numbers(path, f"{prefix}resolution", fields["resolution"], (2,))
        size = (int(width), int(height))
    given = str(fields.get("distortion_model", "") or "").lower()
    if not given and fields.get(coefficients):
        raise VislamError(
            f"{path}: {prefix}distortion_model is missing, of which {coefficients} are: name it, "
            "or give none"
        )
    lens = _MODELS.get(given)
    if lens is None:
        known = ", ".join(name for name in _MODELS if name)
        raise VislamError(
            f"{path}: {prefix}distortion_model is {given!r}: calibrate it as one of {known}"
        )
    D = np.zeros(0)
    if lens:
        D = _numbers(path, f"{prefix}{coefficients}", fields.get(coefficients), COEFFICIENTS[lens])
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return RawCamera(size, K, lens, D)


def _pose(path: Path, field: str, value: Any) -> Array:
    """Pose of 16 numbers, of rows of them, or of OpenCV's matrix with ``data``."""
    data = value.get("data") if isinstance(value, dict) else value
    T = _numbers(path, field, data, (16,)).reshape(4, 4)
    R = T[:3, :3]
    is_rotation = np.allclose(R @ R.T, np.eye(3), atol=_ROTATION_TOLERANCE)
    if not is_rotation or np.linalg.det(R) < 0 or not np.allclose(T[3], [0, 0, 0, 1]):
        raise VislamError(f"{path}: {field} is {T.tolist()}: no pose [[R, p], [0, 1]] of a sensor")
    MOUNT.require(T[:3, 3], f"{path}: {field}")
    return np.vstack([np.column_stack([se3.nearest_rotation(R), T[:3, 3]]), [0.0, 0.0, 0.0, 1.0]])


def _numbers(path: Path, field: str, value: Any, counts: tuple[int, ...]) -> Array:
    try:
        numbers = np.asarray(value, dtype=float).ravel()
    except (ValueError, TypeError, OverflowError):
        numbers = np.empty(0)
    wanted = " or ".join(map(str, counts))
    if value is None or len(numbers) not in counts or not np.all(np.isfinite(numbers)):
        raise VislamError(f"{path}: {field} is {value!r:.100}: give {wanted} finite numbers")
    return numbers
