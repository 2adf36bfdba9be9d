# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter's covariance is that of its errors, over drives it has never seen."""

import numpy as np
import pytest
from tracked_drive import run

from vislam_ros.core import se3
from vislam_ros.core.robocentric import RobocentricFilter
from vislam_ros.core.settings import SlamSettings
from vislam_ros.data.simulation import SimulationSettings, simulate

SEEDS = range(10)


@pytest.mark.parametrize(
    "frozen_share", [0.0, 0.1], ids=["seen throughout", "frozen now and then"]
)
def test_pose_and_bias_errors_fit_their_covariance(frozen_share):
    pose_nees, bias_nees, nis, dof = [], [], 0.0, 0
    for seed in SEEDS:
        simulated = simulate(
            SimulationSettings(
                steps=80, landmarks=400, outlier_share=0.0, frozen_share=frozen_share, seed=seed
            )
        )
        settings = SlamSettings()
        estimator = RobocentricFilter(settings, simulated.drive.camera)
        T_first = simulated.T_world_body[0]
        for k, (_, _, outcome) in enumerate(run(estimator, simulated.drive, settings)):
            nis, dof = nis + outcome.nis, dof + outcome.nis_dof
            if k and k % 20 == 19:
                T_true = se3.inverse(T_first) @ simulated.T_world_body[k]
                error = se3.log(se3.inverse(estimator.T_world_body) @ T_true)
                pose_nees.append(error @ np.linalg.solve(estimator.pose_covariance, error) / 6)
        bias_error = estimator.gyro_bias - 0.002
        bias_nees.append(np.mean((bias_error / estimator.gyro_bias_std) ** 2))
    # Short drives with blind steps leave the filter on its cautious prior of the motion.
    assert 0.3 < np.mean(pose_nees) < 1.6
    assert 0.3 < np.mean(bias_nees) < 2.5
    assert 0.85 < nis / dof < 1.1
