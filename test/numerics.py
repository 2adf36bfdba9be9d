# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Central differences, and random states to try formulas on."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

# A KITTI-like camera that looks forward from a body with x forward, y left, z up.
CAMERA = StereoCamera.from_matrices(
    [[707.0912, 0.0, 601.8873], [0.0, 707.0912, 183.1104], [0.0, 0.0, 1.0]],
    0.537,
    [[0.0, 0.0, 1.0, 1.1], [-1.0, 0.0, 0.0, 0.3], [0.0, -1.0, 0.0, 0.7], [0.0, 0.0, 0.0, 1.0]],
)


def difference(function: Callable[[Array], Array], at: Array, step: float = 1e-6) -> Array:
    """Derivative of a function of a vector (m,) by central differences, (..., m)."""
    columns = []
    for i in range(len(at)):
        offset = np.zeros(len(at))
        offset[i] = step
        columns.append((function(at + offset) - function(at - offset)) / (2 * step))
    return np.stack(columns, axis=-1)


def random_pose(rng: np.random.Generator) -> Array:
    """Pose of any orientation, within tens of metres."""
    return se3.exp(np.concatenate([10 * rng.standard_normal(3), rng.uniform(-1.5, 1.5, 3)]))


def landmarks_ahead(rng: np.random.Generator, T_world_body: Array, count: int) -> Array:
    """World positions (count, 3) that the camera sees from a pose."""
    pixels = rng.uniform([100, 60], [1100, 320], (count, 2))
    y = np.column_stack([pixels[:, 0], pixels[:, 0] - rng.uniform(4, 60, count), pixels[:, 1]])
    points_camera = CAMERA.triangulate(y)
    T = T_world_body @ CAMERA.T_body_camera
    return points_camera @ T[:3, :3].T + T[:3, 3]
