# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files as the course gives them, made from a simulated drive."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

FORWARD_OPTICAL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Optical axes in those of a camera with x forward, y left and z up."""

READINGS = {
    "imu-to-optical": np.linalg.inv,
    "flu-to-imu": lambda T: T @ np.linalg.inv(FORWARD_OPTICAL),
    "optical-to-imu": lambda T: T,
    "imu-to-flu": lambda T: np.linalg.inv(T @ np.linalg.inv(FORWARD_OPTICAL)),
}
"""From the pose of an optical frame in the body to what a file holds, by --extrinsics."""


def dense_features(drive: Drive) -> Array:
    """Features (4, M, T) with -1 where a track is not seen."""
    dense = np.full((4, int(drive.ids.max()) + 1, drive.steps), -1.0)
    for k in range(drive.steps):
        ids, pixels = drive.frame(k)
        dense[:, ids, k] = pixels.T
    return dense


def course_content(
    drive: Drive, reading: str = "imu-to-optical", T_left_right: Array | None = None
) -> dict[str, Any]:
    """Arrays of a drive under the newest names, its cameras as one of the readings has them."""
    camera = drive.camera
    if T_left_right is None:
        T_left_right = np.eye(4)
        T_left_right[0, 3] = camera.baseline
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    stored = READINGS[reading]
    return {
        "v_t": drive.twists[:, :3],
        "w_t": drive.twists[:, 3:],
        "timestamps": drive.feature_stamps / NANOSECONDS,
        "features": dense_features(drive),
        "K_l": K,
        "K_r": K,
        "extL_T_imu": stored(camera.T_body_camera),
        "extR_T_imu": stored(camera.T_body_camera @ T_left_right),
    }


def save_course_file(path: Path, content: dict[str, Any]) -> Path:
    """Write a dict into an .npy file."""
    np.save(path, np.array(content, dtype=object), allow_pickle=True)
    return path


def unrectified(pixels: Array, K: Array, K_right: Array, R_left_right: Array) -> Array:
    """Pixels (..., 4) of a rectified pair as a right camera with other axes has them."""
    u, v = pixels[..., 2], pixels[..., 3]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    turned = rays @ R_left_right @ K_right.T
    return np.concatenate([pixels[..., :2], turned[..., :2] / turned[..., 2:]], axis=-1)


def turned_pair(baseline: float, theta: Array) -> Array:
    """Pose (4, 4) of a right camera beside the left one, turned by a rotation vector."""
    T_left_right = np.eye(4)
    T_left_right[:3, :3] = se3.exp_rotation(theta)
    T_left_right[0, 3] = baseline
    return T_left_right
