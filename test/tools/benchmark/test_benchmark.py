# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmark measures is what it says; how long things take is not tested."""

import itertools
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from benchmark.dense_filter import DenseFilter
from benchmark.drive_times import solve_as_command, solve_here
from benchmark.interleaving import interleave
from benchmark.lapack_floor import LapackFloor
from benchmark.machine import describe_machine
from benchmark.peers.problem import peer_problem
from benchmark.recorded_drive import (
    RecordedDrive,
    first_steps,
    given_gyro_bias,
    record,
)
from benchmark.steady_session import SteadySession

from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.noise.twist_noise import white_noise_levels
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.simulation.simulated_drive import SimulatedDrive
from vislam_ros.data.solving import solve
from vislam_ros.errors import VislamError

SIMULATION = SimulationSettings(
    steps=60, landmarks=300, gyro_bias=(-0.01, 0.02, 0.03), frozen_share=0.1, seed=3
)


@pytest.fixture(scope="module")
def simulated() -> SimulatedDrive:
    return simulate(SIMULATION)


@pytest.fixture(scope="module")
def recorded(simulated: SimulatedDrive) -> RecordedDrive:
    return record(simulated.drive, SlamSettings(), PredictionSettings())


def test_things_are_timed_in_turn_and_the_first_of_each_block_is_left_out() -> None:
    calls: list[str] = []
    clock = itertools.count()

    def timed(name: str) -> float:
        calls.append(name)
        return float(next(clock))

    times = interleave({n: partial(timed, n) for n in "ab"}, rounds=2, block=2)
    assert "".join(calls) == "aaabbbaaabbb"
    np.testing.assert_array_equal(times["a"].seconds, [[1, 2], [7, 8]])
    np.testing.assert_array_equal(times["b"].seconds, [[4, 5], [10, 11]])
    assert times["a"].median_ms == 4500.0
    assert times["b"].ratio_to(times["a"]) == pytest.approx((4.5 / 1.5 + 10.5 / 7.5) / 2)


@pytest.mark.parametrize("estimator", ["robocentric", "joint"])
@pytest.mark.parametrize("turnover", [0, 3])
def test_a_steady_session_has_the_same_number_of_landmarks_at_every_step(
    estimator: str, turnover: int
) -> None:
    settings = slam_settings({"estimator": estimator})
    session = SteadySession(settings, 20, turnover, landmarks=100)
    assert session.last.landmarks >= 100 - 20
    for _ in range(30):
        session.step_seconds()
        step = session.last
        assert (step.active, step.observed, step.rejected, step.frozen) == (20, 20, 0, False)
        assert (step.used, step.admitted) == (20 - turnover, turnover)
        rows, size = session.update_size
        assert rows == 3 * (20 - turnover)
        assert 6 <= size - rows < 20


def test_the_floor_is_an_update() -> None:
    floor = LapackFloor(rows=30, size=40)
    P, HP, S = floor._P.copy(), floor._HP_T.T.copy(), floor._S.copy()
    assert floor() > 0
    assert floor.motion() > 0
    np.testing.assert_allclose(
        np.tril(floor._buffers[2]), np.tril(P - HP.T @ np.linalg.solve(S, HP)), atol=1e-12
    )


def test_the_dense_filter_stays_a_filter() -> None:
    dense = DenseFilter(landmarks=30, seen=10)
    before = np.linalg.eigvalsh(dense._P)
    for _ in range(3):
        assert dense() > 0
    after = np.linalg.eigvalsh(0.5 * (dense._P + dense._P.T))
    assert after[0] > 0
    assert after.sum() < before.sum()
    assert np.all(np.isfinite(dense._means))


def test_watching_the_filter_changes_nothing(
    simulated: SimulatedDrive, recorded: RecordedDrive
) -> None:
    solution = solve(simulated.drive, SlamSettings(), PredictionSettings())
    np.testing.assert_array_equal(recorded.trajectory.positions, solution.trajectory.positions)
    assert len(recorded.filter_steps) == len(recorded.step_seconds) == SIMULATION.steps


def test_noise_and_bias_are_read_off_a_drive() -> None:
    simulation = SimulationSettings(
        steps=600,
        landmarks=60,
        velocity_noise_std=0.5,
        angular_velocity_noise_std=0.05,
        gyro_bias=(0.01, 0.02, 0.03),
    )
    drive = simulate(simulation).drive
    assert drive.ground_truth is not None
    velocity, angular = white_noise_levels(drive.twists)
    assert velocity == pytest.approx(0.5, rel=0.15)
    assert angular == pytest.approx(0.05, rel=0.15)
    assert given_gyro_bias(drive, drive.ground_truth) == pytest.approx(
        [0.01, 0.02, 0.03], abs=4 * 0.05 / np.sqrt(600)
    )


def test_a_drive_is_cut_off_after_some_frames(simulated: SimulatedDrive) -> None:
    drive, whole = first_steps(simulated.drive, 7), simulated.drive
    assert drive.steps == 7
    assert drive.twist_stamps[-1] <= drive.feature_stamps[-1]
    np.testing.assert_array_equal(drive.frame(6)[1], whole.frame(6)[1])
    assert first_steps(whole, 1000) is whole


def test_peers_are_given_what_the_filter_used_and_nothing_that_its_gate_rejected(
    simulated: SimulatedDrive, recorded: RecordedDrive
) -> None:
    problem = peer_problem(
        recorded, simulated.drive.camera, twist_noise=(0.1, 0.01), pixel_std=1.0
    )
    assert problem.steps == SIMULATION.steps
    rejected = 0
    for (keys, points), step in zip(problem.observations, recorded.filter_steps, strict=True):
        rejected += len(step.outcome.rejected)
        assert not np.isin(keys, step.outcome.rejected).any()
        assert len(keys) == len(points) == len(step.frame.keys) - len(step.outcome.rejected)
    assert rejected > 0
    # The twists' own motion, and the bias taken from it.
    twists = simulated.drive.twists
    np.testing.assert_allclose(problem.motion(5, None), 0.1 * twists[5], rtol=1e-5)
    np.testing.assert_allclose(
        problem.motion(5, np.array([1.0, 2.0, 3.0])) - problem.motion(5, None),
        [0, 0, 0, -0.1, -0.2, -0.3],
        rtol=1e-5,
    )


def test_a_whole_drive_is_measured_here_and_as_a_command(
    simulated: SimulatedDrive, tmp_path: Path
) -> None:
    data = tmp_path / "drive.npz"
    truth = write_simulated(data, simulated)
    here = solve_here(
        simulated.drive, SlamSettings(), PredictionSettings(), simulated.drive.ground_truth
    )
    command = solve_as_command(data, [], truth)
    assert here["steps"] == command["steps"] == SIMULATION.steps
    assert command["peak_rss_mb"] > 0
    assert command["user_s"] > 0
    assert command["ate_m"] > 0
    assert here["ate_m"] > 0
    with pytest.raises(VislamError, match=r"ended with 1.*no_such\.npz"):
        solve_as_command(tmp_path / "no_such.npz", [], None)


def test_the_machine_is_described() -> None:
    machine = describe_machine()
    assert machine["usable_cores"] >= 1
    assert any("openblas" in name or name for name in machine["blas"])
