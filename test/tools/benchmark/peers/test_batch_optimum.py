# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The batch optimum is one: its derivatives are right, and no way leads farther down."""

import numpy as np
import pytest
from benchmark.peers.batch_optimum import BatchProblem, BatchState, optimise
from benchmark.peers.problem import PeerProblem, peer_problem
from benchmark.recorded_drive import record
from numerics import difference
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.warp import warp
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

BIAS = (0.01, -0.02, 0.03)
WALK_STD = np.repeat([0.31, 0.05], 3)


def recorded_problem(
    steps: int, landmarks: int, **settings: float
) -> tuple[PeerProblem, NDArray[np.float64], NDArray[np.float64]]:
    """What the filter had of a simulated drive, its poses, and the true ones."""
    simulated = simulate(
        SimulationSettings(steps=steps, landmarks=landmarks, gyro_bias=BIAS, seed=5, **settings)
    )
    recorded = record(simulated.drive, SlamSettings(), PredictionSettings())
    problem = peer_problem(
        recorded, simulated.drive.camera, twist_noise=(0.1, 0.01), pixel_std=1.0
    )
    truth = se3.inverse(simulated.T_world_body[0]) @ simulated.T_world_body
    return problem, recorded.trajectory.T_world_body, truth


@pytest.fixture(scope="module")
def small() -> tuple[PeerProblem, BatchProblem, BatchState]:
    """A few steps, at a state that is not the optimum."""
    problem, filtered, _ = recorded_problem(6, 12)
    batch = BatchProblem(problem, WALK_STD)
    state = batch.start(filtered)
    delta = 0.02 * np.random.default_rng(1).standard_normal(5 * 6 + 3 + 3 * batch.landmarks)
    return problem, batch, batch.moved(state, delta)


@pytest.fixture(scope="module")
def drive() -> tuple[PeerProblem, NDArray[np.float64], NDArray[np.float64]]:
    return recorded_problem(40, 200, frozen_share=0.1)


def jacobian(batch: BatchProblem, state: BatchState) -> NDArray[np.float64]:
    """Derivative of all predictions, in standard deviations, by all that is estimated."""
    seen, twists = batch.residuals(state), batch.twist_residuals(state)
    poses = 6 * batch.steps
    J = np.zeros((batch.observations, 3, poses + 3 + 3 * batch.landmarks))
    for i, (j, k) in enumerate(zip(batch.landmark_of, batch.step_of, strict=True)):
        a, y = batch.anchor_of[j], poses + 3 + 3 * j
        J[i, :, 6 * k : 6 * k + 6] += seen.by_pose[i]
        J[i, :, 6 * a : 6 * a + 6] += seen.by_anchor[i]
        J[i, :, y : y + 3] = seen.by_point[i]
    rows = [J.reshape(-1, J.shape[-1])]
    for derivative, places in zip(twists.derivative, twists.places, strict=True):
        part = np.zeros((*derivative.shape[:2], J.shape[-1]))
        for i, columns in enumerate(places):
            part[i][:, columns] = derivative[i]
        rows.append(part.reshape(-1, J.shape[-1]))
    # The first pose is the origin.
    return np.concatenate(rows)[:, 6:]


def residual(batch: BatchProblem, state: BatchState) -> NDArray[np.float64]:
    parts = [batch.residuals(state).residual, *batch.twist_residuals(state).residual]
    return np.concatenate([part.ravel() for part in parts])


def test_derivatives_are_those_of_finite_differences(
    small: tuple[PeerProblem, BatchProblem, BatchState],
) -> None:
    _, batch, state = small
    J = jacobian(batch, state)
    numeric = -difference(
        lambda delta: residual(batch, batch.moved(state, delta)), np.zeros(J.shape[1])
    )
    np.testing.assert_allclose(J, numeric, rtol=1e-5, atol=1e-5)


def test_observations_are_predicted_as_the_filter_predicts_them(
    small: tuple[PeerProblem, BatchProblem, BatchState],
) -> None:
    problem, batch, state = small
    T = state.T_world_body
    observed = residual(batch, state)[: 3 * batch.observations].reshape(-1, 3)
    for i, (j, k) in enumerate(zip(batch.landmark_of, batch.step_of, strict=True)):
        motion = se3.inverse(T[batch.anchor_of[j]]) @ T[k]
        predicted = warp(problem.camera, state.image_points[j][None], motion).y[0]
        _, points = problem.observations[k]
        errors = (points - predicted) / problem.pixel_std
        assert np.min(np.linalg.norm(errors - observed[i], axis=1)) < 1e-9


def test_a_newton_step_is_the_least_squares_solution_without_any_elimination(
    small: tuple[PeerProblem, BatchProblem, BatchState],
) -> None:
    _, batch, state = small
    J, r = jacobian(batch, state), residual(batch, state)
    root = np.ones(len(r))
    root[: 3 * batch.observations] = np.repeat(np.sqrt(batch.residuals(state).weight), 3)
    dense = np.linalg.lstsq(root[:, None] * J, root * r, rcond=None)[0]
    np.testing.assert_allclose(batch.newton_step(state), dense, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("walk", [None, WALK_STD], ids=["any motion", "smooth motion"])
def test_every_iteration_goes_down_and_filter_and_truth_lead_to_the_same_optimum(
    drive: tuple[PeerProblem, NDArray[np.float64], NDArray[np.float64]],
    walk: NDArray[np.float64] | None,
) -> None:
    problem, filtered, truth = drive
    batch = BatchProblem(problem, walk)
    ends = []
    for start in (filtered, truth):
        result = optimise(batch, batch.start(start), tolerance=1e-8, max_iterations=200)
        assert result.converged
        assert np.all(np.diff(result.costs[:-1]) < 0)
        assert result.costs[-1] <= result.costs[-2] * (1 + 1e-12)
        ends.append(result.state)
    np.testing.assert_allclose(ends[0].T_world_body, ends[1].T_world_body, atol=1e-6)
    np.testing.assert_allclose(ends[0].gyro_bias, ends[1].gyro_bias, atol=1e-6)


def test_the_optimum_of_exact_observations_is_the_truth() -> None:
    problem, filtered, truth = recorded_problem(
        30,
        150,
        pixel_noise_std=0.0,
        velocity_noise_std=0.0,
        angular_velocity_noise_std=0.0,
        outlier_share=0.0,
    )
    batch = BatchProblem(problem)
    result = optimise(batch, batch.start(filtered))
    assert result.costs[-1] < 1e-4 < result.costs[0]
    np.testing.assert_allclose(result.state.T_world_body, truth, atol=1e-4)
    np.testing.assert_allclose(result.state.gyro_bias, BIAS, atol=1e-5)


def test_a_landmark_that_was_seen_once_is_left_out(
    small: tuple[PeerProblem, BatchProblem, BatchState],
) -> None:
    problem, batch, _ = small
    _, counts = np.unique(
        np.concatenate([keys for keys, _ in problem.observations]), return_counts=True
    )
    assert np.any(counts == 1)
    assert batch.landmarks == np.sum(counts > 1)
    assert batch.observations == np.sum(counts[counts > 1])
