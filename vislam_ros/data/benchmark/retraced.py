# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a drive's NEES is the filter's or luck: the same motion, with other noise.

A drive is one draw of its noise, and the error of a filter wanders slowly, so a drive has but a
few independent values of it. Drives simulated along its reference, with its own number of tracks
and share of frozen steps, bias and noise of the twist, tell how NEES and ATE are spread.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.stats import median_abs_deviation

from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.benchmark.consistency import judged, std_error
from vislam_ros.data.benchmark.recorded_drive import twist_errors
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation import associate
from vislam_ros.data.simulation import SimulationSettings, simulate
from vislam_ros.data.solving import Solution, covariances_of, solve
from vislam_ros.data.trajectory import Trajectory


def retrace(
    drive: Drive,
    reference: Trajectory,
    slam_settings: SlamSettings,
    prediction_settings: PredictionSettings,
    seeds: Iterable[int],
    *,
    on_progress: Callable[[str], None],
) -> dict[str, Any]:
    """Solve a drive, and simulated ones along its reference.

    Returns
    -------
    dict
        ``runs``: a row for the drive and one for the simulated ones, with the means of ``nees``
        and ``ate_m`` and, of the latter, the ``nees_std_error``, least and greatest; and what was
        ``simulated``, and the figures of all ``drives``.
    """
    solution = solve(drive, slam_settings, prediction_settings)
    rows, _ = associate(reference, solution.trajectory)
    along = Trajectory(
        reference.stamps[rows], reference.positions[rows], reference.quaternions[rows]
    )
    settings = _simulation(drive, reference, solution, len(along))
    retraced = []
    for seed in seeds:
        on_progress(f"along the reference of {drive.name}, seed {seed}")
        simulated = simulate(dataclasses.replace(settings, seed=seed), along).drive
        assert simulated.ground_truth is not None
        again = solve(simulated, slam_settings, prediction_settings)
        retraced.append(_judged(again, simulated.ground_truth))
    nees, ate = (np.array([row[name] for row in retraced]) for name in ("nees", "ate_m"))
    return {
        "runs": [
            {"name": drive.name, "drives": 1, **_judged(solution, reference)},
            {
                "name": "simulated along its reference",
                "drives": len(retraced),
                "nees": float(nees.mean()),
                "nees_std_error": std_error(nees),
                "nees_least": float(nees.min()),
                "nees_greatest": float(nees.max()),
                "ate_m": float(ate.mean()),
                "ate_least_m": float(ate.min()),
                "ate_greatest_m": float(ate.max()),
            },
        ],
        "simulated": dataclasses.asdict(settings),
        "drives": retraced,
    }


def _simulation(
    drive: Drive, reference: Trajectory, solution: Solution, steps: int
) -> SimulationSettings:
    """Settings of drives that are like one as far as its reference tells."""
    errors = twist_errors(drive, reference)
    # Differences of neighbours are free of slow errors; the quietest axis, of the reference's own.
    noise = median_abs_deviation(np.diff(errors, axis=0), scale="normal") / np.sqrt(2.0)
    frozen = sum(step.frozen for step in solution.steps) / len(solution.steps)
    x, y, z = errors[:, 3:].mean(axis=0).tolist()
    return SimulationSettings(
        steps=steps,
        landmarks=drive.tracks,
        velocity_noise_std=float(noise[:3].min()),
        angular_velocity_noise_std=float(noise[3:].min()),
        gyro_bias=(x, y, z),
        frozen_share=min(frozen, 0.5),
    )


def _judged(solution: Solution, reference: Trajectory) -> dict[str, float]:
    return judged(reference, solution.trajectory, covariances_of(solution.steps))
