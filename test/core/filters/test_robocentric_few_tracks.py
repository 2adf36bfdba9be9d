# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A handful of tracks, some of them wrong: vision helps, and makes nothing up."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vislam_ros.core.filters.quantities import GYRO_BIAS
from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.simulation.simulated_drive import SimulatedDrive
from vislam_ros.data.solving import solve

Array = NDArray[np.float64]

CLEAN = {"velocity_noise_std": 0.02, "angular_velocity_noise_std": 0.001}
NO_BIAS = (0.0, 0.0, 0.0)


def few_tracks(seed: int, **settings: Any) -> SimulatedDrive:
    """Simulate a drive of 30 s with six features a frame, of which a quarter slides."""
    simulated = simulate(steps=300, landmarks=125, outlier_share=0.25, seed=seed, **settings)
    assert 4 < np.mean(np.diff(simulated.drive.offsets)) < 8
    return simulated


def position_error(simulated: SimulatedDrive, **settings: Any) -> float:
    """Root mean square of the position error, metres."""
    positions = solve(simulated.drive, **settings).trajectory.positions
    T = se3.inverse(simulated.T_world_body[0]) @ simulated.T_world_body
    return float(np.sqrt(np.mean(np.sum((positions - T[:, :3, 3]) ** 2, axis=1))))


def test_with_six_features_a_frame_of_which_a_quarter_slides_vision_helps() -> None:
    errors = []
    for seed in range(4):
        simulated = few_tracks(seed)
        filtered = position_error(simulated)
        errors.append((filtered, position_error(simulated, estimator="dead_reckoning")))
    filtered_errors, reckoned_errors = np.mean(errors, axis=0)
    assert filtered_errors < 0.7 * reckoned_errors


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_where_there_is_no_bias_few_tracks_make_none_up(seed: int) -> None:
    simulated = few_tracks(seed, gyro_bias=NO_BIAS, **CLEAN)
    steps = solve(simulated.drive).steps
    bias = np.column_stack([steps[name] for name in GYRO_BIAS.names])
    assert np.max(np.abs(bias[-100:])) < 0.001
