# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter's covariance is that of its errors, over drives it has never seen."""

import numpy as np
import pytest
from tracked_drive import run

from vislam_ros.core.filters.quantities import GYRO_BIAS
from vislam_ros.core.filters.robocentric import RobocentricFilter
from vislam_ros.core.filters.robocentric_model import GYRO_BIAS as BIAS
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

SEEDS = range(10)


def pose_nees(pose, simulated, k):
    T_true = se3.inverse(simulated.T_world_body[0]) @ simulated.T_world_body[k]
    error = se3.log(se3.inverse(pose.T_world_body) @ T_true)
    return error @ np.linalg.solve(pose.covariance, error) / 6


def twist_nees(twist, simulated, k, tau):
    """NEES by degree of the body's twist, in its own axes, over the step that ends with pose k."""
    before, after = simulated.T_world_body[k - 1 : k + 1]
    error = twist.mean - se3.log(se3.inverse(before) @ after) / tau
    return error @ np.linalg.solve(twist.covariance, error) / 6


@pytest.mark.parametrize(
    "frozen_share", [0.0, 0.1], ids=["seen throughout", "frozen now and then"]
)
def test_pose_twist_and_bias_errors_fit_their_covariance(frozen_share):
    of_poses, of_twists, of_biases, nis, dof = [], [], [], 0.0, 0
    for seed in SEEDS:
        simulated = simulate(
            SimulationSettings(
                steps=80, landmarks=400, outlier_share=0.0, frozen_share=frozen_share, seed=seed
            )
        )
        settings = RobocentricSettings()
        estimator = RobocentricFilter(settings, simulated.drive.camera)
        for k, (motion, _, outcome) in enumerate(run(estimator, simulated.drive, settings)):
            nis, dof = nis + outcome.nis, dof + outcome.nis_dof
            if k and k % 20 == 19:
                of_poses.append(pose_nees(outcome.pose, simulated, k))
                of_twists.append(twist_nees(outcome.twist, simulated, k, motion.duration))
        error = estimator.vehicle.gyro_bias - 0.002
        P = estimator.covariance[BIAS, BIAS]
        of_biases.append(error @ np.linalg.solve(P, error) / 3)
        told = next(told for told in outcome.estimates if told.quantity == GYRO_BIAS)
        assert np.all(np.abs(told.values - 0.002) < 4.0 * told.std)
    # Short drives with blind steps leave the filter on its cautious prior of the motion.
    assert 0.3 < np.mean(of_poses) < 1.6
    assert 0.3 < np.mean(of_twists) < 1.6
    assert 0.3 < np.mean(of_biases) < 2.5
    assert 0.85 < nis / dof < 1.1


def nees_at_the_end(simulated, settings):
    estimator = RobocentricFilter(settings, simulated.drive.camera)
    *_, (_, _, outcome) = run(estimator, simulated.drive, settings)
    return pose_nees(outcome.pose, simulated, -1)


def test_errors_that_disparities_keep_are_known_for_what_they_are():
    known, unknown = [], []
    for seed in SEEDS:
        simulated = simulate(
            SimulationSettings(
                steps=120,
                landmarks=600,
                outlier_share=0.0,
                pixel_noise_std=0.05,
                disparity_offset_std=0.6,
                seed=seed,
            )
        )
        known.append(nees_at_the_end(simulated, RobocentricSettings()))
        unknown.append(nees_at_the_end(simulated, RobocentricSettings(disparity_offset_std=0.0)))
    # It is told twenty times the noise, and takes its time to find that out.
    assert 0.15 < np.mean(known) < 1.4
    assert np.mean(unknown) > 2 * np.mean(known)
