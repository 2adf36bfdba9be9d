# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Small drives, and results, for the tests of the data layer."""

from pathlib import Path

import numpy as np
import pytest
from step_rows import step_row

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.drive import Drive
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.data.results.writer import ResultWriter
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


@pytest.fixture
def round_drive() -> Trajectory:
    """A round of 20 m radius, 60 poses that climb."""
    step = se3.exp([2.0, 0.0, 0.02, 0.0, 0.0, 0.1])
    T = [np.eye(4)]
    for _ in range(59):
        T.append(T[-1] @ step)
    return Trajectory.from_matrices(10**8 * np.arange(1, 61), np.array(T))


@pytest.fixture
def round_results(round_drive: Trajectory, tmp_path: Path) -> Results:
    """A run over it that is right, with a dead reckoning that is not, and three landmarks."""
    growth = np.linspace(0.0, 1.0, len(round_drive)) ** 2
    with ResultWriter(tmp_path / "results") as writer:
        writer.summary.drive = "round"
        writer.set_parameters({"slam_node": {"estimator": "robocentric", "chi2_gate": 16.27}})
        for k, stamp in enumerate(round_drive.stamps.tolist()):
            pose = (round_drive.positions[k], round_drive.quaternions[k])
            dof = 0 if k % 9 == 0 else 90
            counts = {"active": 40, "used": dof // 3, "rejected": k % 3, "observed": 45}
            row = step_row(stamp, frozen=dof == 0, ms=1.5, **counts, nis=float(dof), nis_dof=dof)
            row["gyro_bias_x"] = 0.01 * growth[k]
            covariance = np.diag([4.0, 1.0, 0.25, 0.01, 0.01, 0.01]) * growth[k]
            writer.add_step(*pose, covariance, row)
            writer.add_dead_reckoning(stamp, pose[0] * 1.1, pose[1])
        points = np.array([[0.0, 5.0, 0.0], [10.0, 20.0, 1.0], [1e6, 0.0, 0.0]])
        count = np.arange(3, dtype=np.uint32)
        covariances = np.array([1.0, 4.0, 1e6])[:, None, None] * np.eye(3)
        writer.set_landmarks(LandmarkMap(count, count * 0, points, covariances))
        writer.finish(complete=True)
    return read_results(writer.directory)


@pytest.fixture
def moved_round(round_drive: Trajectory) -> Trajectory:
    """The same drive in a frame of its own, as a reference has it."""
    T = se3.exp([50.0, 0.0, 0.0, 0.0, 0.3, 2.0]) @ round_drive.T_world_body
    return Trajectory.from_matrices(round_drive.stamps, T)
