# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of a small world with exact truth."""

import numpy as np
import pytest
from frontend.rendered_world import Rectangle, Shot, camera_of, room, stereo_view

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

SIZE = 376, 240


@pytest.fixture(scope="session")
def camera() -> StereoCamera:
    return camera_of(*SIZE, 0.11)


@pytest.fixture(scope="session")
def world() -> list[Rectangle]:
    return room(np.random.default_rng(1), (3.0, 2.0, 4.0))


@pytest.fixture(scope="session")
def walk(camera: StereoCamera, world: list[Rectangle]) -> tuple[Shot, ...]:
    """Eight shots of a camera that moves and turns in a room."""
    rng = np.random.default_rng(2)
    pose = np.eye(4)
    shots = []
    for k in range(8):
        shots.append(stereo_view(world, camera, SIZE, pose, rng))
        sway = [0.03, 0.02, 0.05, 0.01, 0.03, 0.02] * np.cos(k / 4 + np.arange(6) / 3)
        pose = pose @ se3.exp(sway)
    return tuple(shots)


@pytest.fixture(scope="session")
def stand(camera: StereoCamera, world: list[Rectangle]) -> tuple[Shot, ...]:
    """Five shots of a camera that stands: the sensors' noise is all that changes."""
    rng = np.random.default_rng(3)
    return tuple(stereo_view(world, camera, SIZE, np.eye(4), rng) for _ in range(5))
