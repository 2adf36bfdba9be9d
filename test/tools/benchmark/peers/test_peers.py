# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""GTSAM's estimators solve the problem that our filter was given."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmark.peers.comparison import PeerComparison
from benchmark.peers.gtsam_factors import GraphGrowth, GtsamFactors, Recipe
from benchmark.peers.gtsam_runs import (
    PeerFailure,
    run_batch,
    run_fixed_lag,
    run_isam2,
)
from benchmark.peers.problem import PeerProblem
from benchmark.steady_session import CAMERA
from numpy.typing import NDArray

from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

pytest.importorskip("gtsam", reason="needs GTSAM: pip install gtsam")

STEPS, LANDMARKS = 25, 20
TWIST_STD = np.repeat([0.1, 0.01], 3)
BIAS = np.array([0.02, -0.01, 0.03])


def true_poses() -> NDArray[np.float64]:
    step = se3.exp([0.3, 0.02, 0.0, 0.002, -0.001, 0.01])
    T = [np.eye(4)]
    for _ in range(STEPS - 1):
        T.append(T[-1] @ step)
    return np.array(T)


@pytest.fixture(scope="module")
def problem() -> PeerProblem:
    """All landmarks seen at all steps; the twists have noise and a bias."""
    rng = np.random.default_rng(5)
    T = true_poses()
    y = np.column_stack(
        [rng.uniform(300, 900, LANDMARKS), np.zeros(LANDMARKS), rng.uniform(50, 300, LANDMARKS)]
    )
    y[:, 1] = y[:, 0] - rng.uniform(8, 20, LANDMARKS)
    T_body_camera = CAMERA.T_body_camera
    points = CAMERA.triangulate(y) @ T_body_camera[:3, :3].T + T_body_camera[:3, 3]
    observations = []
    for pose in T:
        T_camera_world = se3.inverse(pose @ T_body_camera)
        exact = CAMERA.project(points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3])
        observations.append((np.arange(LANDMARKS), exact + rng.standard_normal(exact.shape)))
    motions = se3.log(se3.inverse(T[:-1]) @ T[1:]) + 0.1 * TWIST_STD * rng.standard_normal(
        (STEPS - 1, 6)
    )
    motions[:, 3:] += 0.1 * BIAS
    return PeerProblem(
        camera=CAMERA,
        durations=np.array([0.0] + [0.1] * (STEPS - 1)),
        motions=np.concatenate([np.zeros((1, 6)), motions]),
        twist_std=TWIST_STD,
        pixel_std=np.ones(3),
        observations=tuple(observations),
    )


def largest_error(poses: NDArray[np.float64]) -> np.float64:
    return np.linalg.norm(poses[:, :3, 3] - true_poses()[:, :3, 3], axis=1).max()


@pytest.mark.parametrize("run", [run_isam2, run_fixed_lag])
def test_smoothers_find_the_path_as_they_go(problem: PeerProblem, run: Callable[..., Any]) -> None:
    result = run(problem, Recipe(1.0, 10.0), BIAS)
    assert largest_error(result.online) < 0.15
    assert result.landmarks == LANDMARKS
    assert result.observations == LANDMARKS * STEPS
    assert len(result.update_seconds) == STEPS


def test_the_batch_finds_the_path_from_dead_reckoning(problem: PeerProblem) -> None:
    poses = [np.eye(4)]
    for k in range(1, STEPS):
        poses.append(poses[-1] @ se3.exp(problem.motion(k, None)))
    reckoned = np.array(poses)
    result = run_batch(problem, Recipe(1.0, 30.0), reckoned, BIAS)
    assert result.final is not None
    assert largest_error(result.final) < 0.15 < largest_error(reckoned)
    again = run_batch(problem, Recipe(1.0, 30.0), result.final, BIAS)
    assert again.cost == pytest.approx(result.cost, rel=1e-3)


def test_a_landmark_enters_with_its_second_observation_and_enough_disparity(
    problem: PeerProblem,
) -> None:
    growth = GraphGrowth(GtsamFactors(problem), Recipe(14.0), None, memory=STEPS)
    disparity = np.array([points[:, 0] - points[:, 1] for _, points in problem.observations])
    growth.step(0, np.eye(4))
    assert growth.landmarks == growth.observations == 0
    growth.step(1, np.eye(4))
    assert growth.landmarks == np.sum(disparity[1] >= 14.0)
    assert growth.observations == 2 * growth.landmarks


def test_a_peer_that_gives_up_says_where(problem: PeerProblem) -> None:
    # Nothing ties this landmark down: behind the camera it has no projection.
    keys, points = problem.observations[-1]
    broken = points.copy()
    broken[:, 1] = broken[:, 0] + 50.0
    observations = (*problem.observations[:2], *[(keys, broken)] * (STEPS - 2))
    bad = PeerProblem(**{**vars(problem), "observations": observations})
    with pytest.raises(PeerFailure, match=r"gave up at step \d+"):
        run_isam2(bad, Recipe(1.0), BIAS)


@pytest.fixture
def said() -> list[str]:
    """What a comparison says as it goes."""
    return []


@pytest.fixture
def comparison(said: list[str]) -> PeerComparison:
    drive = simulate(SimulationSettings(steps=50, landmarks=250, seed=4)).drive
    assert drive.ground_truth is not None
    return PeerComparison(
        drive,
        drive.ground_truth,
        slam_settings({}),
        PredictionSettings(),
        on_progress=said.append,
    )


def test_a_long_drive_is_given_to_those_peers_that_reach_its_end(
    comparison: PeerComparison,
) -> None:
    rows = {row["name"]: row for row in comparison.run(every=False)["runs"]}
    assert set(rows) == {
        "robocentric",
        "isam2, bias given",
        "isam2, bias given, near landmarks",
        "fixed lag of 2 s, bias given",
        "batch, bias given",
    }
    assert rows["isam2, bias given"]["recipe"] == "from 4 px, prior 1"


def test_peers_stand_beside_our_filter_in_one_table(
    comparison: PeerComparison, said: list[str]
) -> None:
    table = comparison.run()
    runs = {row["name"]: row for row in table["runs"]}
    assert set(runs) >= {
        "robocentric",
        "isam2",
        "isam2, bias given",
        "isam2, bias given, relinearised carefully",
        "batch, bias given",
    }
    for row in runs.values():
        assert row["step_ms"] > 0
        assert row["times_ours"] > 0
        assert (row["ate_online_m"] or row["ate_final_m"]) < 2.0
    assert len(said) >= len(runs)
