# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The default settings on drives like the real ones: all features, outliers, a gyroscope bias."""

from dataclasses import dataclass

import numpy as np
import pytest

from vislam_ros.core.filters.flat_settings import slam_settings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve

SEEDS = range(3)


@dataclass(frozen=True)
class Figures:
    nees: float
    nis: float
    ate_to_dead_reckoning: float
    rejected_share: float


def monte_carlo(
    estimator: str, frozen_share: float, twist_noise: float, pixel_noise: float = 1.0
) -> Figures:
    """Mean figures of drives of 24 s; an angular velocity has a tenth of a velocity's noise."""
    noise = {
        "velocity_noise_std": twist_noise,
        "angular_velocity_noise_std": 0.1 * twist_noise,
    }
    # The robocentric filter finds the noise; the others are told.
    told = {} if estimator == "robocentric" else noise
    settings = slam_settings({"estimator": estimator, **told})
    nees, nis, ate, dead_reckoning, rejected = [], [], [], [], []
    for seed in SEEDS:
        bias = np.random.default_rng(seed).uniform(0.002, 0.01, 3) * [1, -1, 1]
        drive = simulate(
            SimulationSettings(
                steps=240,
                landmarks=1060,
                seed=seed,
                frozen_share=frozen_share,
                gyro_bias=tuple(bias.tolist()),
                pixel_noise_std=pixel_noise,
                **noise,
            )
        ).drive
        assert drive.ground_truth is not None
        solution = solve(drive, settings, PredictionSettings())
        covariances = solution.trajectory.covariances
        figures = compare(drive.ground_truth, solution.trajectory, covariances)
        nees.append(figures["nees_per_dof"])
        ate.append(figures["ate_m"]["rmse"])
        dead_reckoning.append(
            compare(drive.ground_truth, solution.dead_reckoning)["ate_m"]["rmse"]
        )
        nis.append(solution.summary["nis_per_dof"])
        steps = solution.steps
        rejected.append(np.sum(steps["rejected"]) / np.sum(steps["observed"]))
    return Figures(
        float(np.mean(nees)),
        float(np.mean(nis)),
        float(np.mean(ate) / np.mean(dead_reckoning)),
        float(np.mean(rejected)),
    )


@pytest.mark.parametrize(
    "frozen_share", [0.0, 0.1], ids=["seen throughout", "frozen now and then"]
)
def test_robocentric_knows_its_error(frozen_share: float) -> None:
    figures = monte_carlo("robocentric", frozen_share, twist_noise=0.1)
    # Over 20 seeds the mean is near 1; three drives of one error each leave it this uncertain.
    assert 0.45 < figures.nees < 1.7
    # The sliding tracks raise the level of the pixel noise by some per cent.
    assert 0.9 < figures.nis < 1.1
    assert figures.ate_to_dead_reckoning < 0.1
    assert figures.rejected_share < 0.03


def test_so_it_does_where_the_twist_is_noisy_and_nobody_told_it() -> None:
    figures = monte_carlo("robocentric", 0.1, twist_noise=0.5)
    assert 0.5 < figures.nees < 2.0
    assert figures.ate_to_dead_reckoning < 0.2


def test_so_it_does_where_pixels_are_three_times_as_noisy_as_it_was_told() -> None:
    figures = monte_carlo("robocentric", 0.0, twist_noise=0.1, pixel_noise=3.0)
    assert 0.5 < figures.nees < 3.0
    assert figures.rejected_share < 0.03


def test_joint_is_overconfident_on_the_same_drives() -> None:
    figures = monte_carlo("joint", 0.0, twist_noise=0.1)
    assert figures.nees > 5
    assert figures.ate_to_dead_reckoning < 0.3
