# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.benchmark.retraced import retrace
from vislam_ros.data.evaluation import compare
from vislam_ros.data.simulation import SimulationSettings, simulate
from vislam_ros.data.solving import covariances_of, solve

SETTINGS = SimulationSettings(
    steps=200,
    landmarks=900,
    velocity_noise_std=0.3,
    angular_velocity_noise_std=0.03,
    gyro_bias=(0.01, -0.01, 0.005),
    frozen_share=0.1,
    seed=7,
)


@pytest.fixture(scope="module")
def drive():
    return simulate(SETTINGS).drive


@pytest.fixture(scope="module")
def retraced(drive):
    return retrace(
        drive,
        drive.ground_truth,
        SlamSettings(),
        PredictionSettings(),
        range(3),
        on_progress=lambda what: None,
    )


def test_the_simulated_drives_have_what_the_drive_has(retraced):
    simulated = retraced["simulated"]
    assert (simulated["steps"], simulated["landmarks"]) == (200, 900)
    assert simulated["velocity_noise_std"] == pytest.approx(0.3, rel=0.2)
    assert simulated["angular_velocity_noise_std"] == pytest.approx(0.03, rel=0.2)
    assert simulated["gyro_bias"] == pytest.approx(SETTINGS.gyro_bias, abs=4 * 0.03 / 200**0.5)
    assert simulated["frozen_share"] == pytest.approx(0.1, abs=0.02)


def test_the_drive_stands_beside_the_mean_of_the_others(drive, retraced):
    itself, others = retraced["runs"]
    solution = solve(drive, SlamSettings(), PredictionSettings())
    covariances = covariances_of(solution.steps)
    expected = compare(drive.ground_truth, solution.trajectory, covariances)
    assert itself["nees"] == expected["nees_per_dof"]
    assert itself["ate_m"] == expected["ate_m"]["rmse"]
    nees = [row["nees"] for row in retraced["drives"]]
    assert len(set(nees)) == others["drives"] == 3
    assert others["nees"] == pytest.approx(np.mean(nees))
    assert (others["nees_least"], others["nees_greatest"]) == (min(nees), max(nees))
