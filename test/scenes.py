# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Small scenes whose every number is known: a body that moves past landmarks."""

from dataclasses import dataclass

import numpy as np
from numerics import CAMERA, landmarks_ahead
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment, Part
from vislam_ros.core.tracking.tracked_frame import TrackedFrame

Array = NDArray[np.float64]


STANDING = Increment(np.eye(4), 0.0, np.zeros((6, 6)))


def frame_of(keys: ArrayLike, pixels: Array) -> TrackedFrame:
    """Return a frame in which no track has ended and none is frozen."""
    keys, nothing = np.asarray(keys, dtype=np.int64), np.empty(0, dtype=np.int64)
    return TrackedFrame(keys, pixels, nothing, np.zeros(len(keys), dtype=bool), frozen=False)


@dataclass(frozen=True)
class Scene:
    """True poses, noisy increments and frames in which landmarks come and go."""

    T_world_body: Array
    increments: list[Increment]
    frames: list[TrackedFrame]
    landmarks: Array


def pixels_of(T_world_body: Array, landmarks: Array) -> Array:
    """Exact pixels (n, 4) of landmarks (n, 3) in the world."""
    T = se3.inverse(T_world_body @ CAMERA.T_body_camera)
    y = CAMERA.project(landmarks @ T[:3, :3].T + T[:3, 3])
    return y[:, [0, 2, 1, 2]]


def passing_scene(seed: int, steps: int = 25, born_each_step: int = 3, life: int = 6) -> Scene:
    """Drive a gentle curve; each landmark is seen in ``life`` consecutive frames."""
    rng = np.random.default_rng(seed)
    std = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])
    T, increments = [np.eye(4)], [STANDING]
    for _ in range(steps - 1):
        step = se3.exp([0.3, 0, 0.01, 0.002, -0.004, 0.02])
        T.append(T[-1] @ step)
        noisy = step @ se3.exp(std * rng.standard_normal(6))
        part = Part(0.1, se3.log(noisy) / 0.1)
        increments.append(Increment(noisy, 0.1, np.diag(std**2), (part,)))
    landmarks = np.concatenate([landmarks_ahead(rng, pose, born_each_step) for pose in T])
    born = np.repeat(np.arange(steps), born_each_step)
    frames = []
    for k in range(steps):
        keys = np.nonzero((born <= k) & (k < born + life))[0]
        exact = pixels_of(T[k], landmarks[keys])
        frames.append(
            TrackedFrame(
                keys=keys,
                pixels=exact + rng.standard_normal(exact.shape),
                ended=np.nonzero(born + life == k)[0],
                copied=np.zeros(len(keys), dtype=bool),
                frozen=False,
            )
        )
    return Scene(np.array(T), increments, frames, landmarks)
