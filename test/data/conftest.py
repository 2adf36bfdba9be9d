# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Small drives for the tests of the data layer."""

import numpy as np
import pytest

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import Trajectory

STEPS = 120
START = 1_317_000_000_123_456_789


@pytest.fixture
def small_drive() -> Drive:
    """A drive of random numbers: uneven stamps, a frame without features, ground truth."""
    rng = np.random.default_rng(20)
    stamps = START + np.cumsum(rng.integers(90_000_000, 110_000_000, STEPS))
    counts = rng.integers(1, 9, STEPS)
    counts[3] = 0
    ids = [np.sort(rng.choice(200, count, replace=False)) for count in counts]
    quaternions = rng.normal(size=(STEPS - 5, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return Drive(
        name="a drive",
        camera=StereoCamera(
            fx=718.1 + rng.random(),
            fy=717.9 + rng.random(),
            cx=607.1928,
            cy=185.2157,
            fx_baseline=386.1448 + rng.random(),
            position_body_camera=(1.08 + rng.random(), -0.31, 0.72),
            quaternion_body_camera=(0.5, -0.5, 0.5, -0.5),
        ),
        image_size=(1241, 376),
        twist_stamps=stamps,
        twists=rng.normal(size=(STEPS, 6)),
        feature_stamps=stamps.copy(),
        offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        ids=np.concatenate(ids).astype(np.uint32),
        pixels=rng.uniform(-50, 1300, (counts.sum(), 4)).astype(np.float32),
        ground_truth=Trajectory(stamps[:-5], rng.normal(size=(STEPS - 5, 3)), quaternions),
        notes=("the IMU's frame was turned", "two steps had the same time"),
    )
