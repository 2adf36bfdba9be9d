# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the filters know their own error, and how near they come to the batch optimum.

Drives are simulated over and over: all features, a gyroscope's bias of random size, outliers,
disparities as on the real drives; with little and with much noise of the twist, with frozen steps
and without. Each is solved by the filters, and by the batch optimum on the same tracks.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.peers.batch_optimum import BatchProblem, optimise
from benchmark.peers.problem import PeerProblem, peer_problem
from benchmark.recorded_drive import record
from vislam_ros.core.filters.flat_settings import replaced
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import smoothed_trajectory, solve
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

#: Observations of a smaller disparity are counted: drive 03 has a twentieth of them, pixels.
SMALL_DISPARITY = 1.3

_PIXEL_STD = 1.0
# On each axis, rad/s.
_SMALLEST_BIAS, _LARGEST_BIAS = 0.002, 0.01
# The search for the optimum ends when nothing moves by more than this, metres and radians.
_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Cell:
    """A kind of drive.

    Attributes
    ----------
    velocity_noise_std, angular_velocity_noise_std : float
        White noise of the twist, m/s and rad/s.
    frozen_share : float
        Of the steps.
    steps, landmarks : int
    """

    velocity_noise_std: float
    angular_velocity_noise_std: float
    frozen_share: float
    steps: int = 300
    landmarks: int = 1320

    def simulation(self, seed: int) -> SimulationSettings:
        """Settings of one drive of this kind, its bias drawn with the seed."""
        rng = np.random.default_rng([seed, 1])
        bias = rng.uniform(_SMALLEST_BIAS, _LARGEST_BIAS, 3) * rng.choice([-1.0, 1.0], 3)
        return SimulationSettings(
            steps=self.steps,
            landmarks=self.landmarks,
            velocity_noise_std=self.velocity_noise_std,
            angular_velocity_noise_std=self.angular_velocity_noise_std,
            frozen_share=self.frozen_share,
            gyro_bias=tuple(bias.tolist()),
            seed=seed,
        )


#: With little and with much noise of the twist, without frozen steps and with.
CELLS = tuple(
    Cell(velocity, angular, frozen)
    for velocity, angular in ((0.1, 0.01), (0.5, 0.05))
    for frozen in (0.0, 0.1)
)


class MonteCarlo:
    """Solves drives of each kind.

    Parameters
    ----------
    slam_settings, prediction_settings : SlamSettings, PredictionSettings
        The estimator is set here, and so is the noise of the twist that the joint filter is given;
        the robocentric one finds it.
    on_progress : callable
        Called with what is run next.
    """

    def __init__(
        self,
        slam_settings: SlamSettings,
        prediction_settings: PredictionSettings,
        *,
        on_progress: Callable[[str], None],
    ):
        self._slam_settings = slam_settings
        self._prediction_settings = prediction_settings
        self._on_progress = on_progress

    def run(self, seeds: Iterable[int], cells: Sequence[Cell] = CELLS) -> dict[str, Any]:
        """Solve a drive of each kind with each seed.

        Returns
        -------
        dict
            ``runs``, rows of means as :func:`summary` makes them; ``disparities`` of all
            observations; and what the means were made of, ``drives``.
        """
        seeds = list(seeds)
        rows, drives, disparities = [], [], []
        for cell in cells:
            figures = []
            for seed in seeds:
                self._on_progress(
                    f"{cell.velocity_noise_std:g} m/s, {cell.frozen_share:.0%} frozen, seed {seed}"
                )
                drive = simulate(cell.simulation(seed)).drive
                disparities.append(drive.pixels[:, 0].astype(float) - drive.pixels[:, 2])
                figures.append({"seed": seed, **self.figures(cell, drive)})
            rows += [{**_name(cell), **row} for row in summary(figures)]
            drives += [{**_name(cell), **drive_figures} for drive_figures in figures]
        return {
            "seeds": len(seeds),
            "disparities": spread(np.concatenate(disparities)),
            "runs": rows,
            "drives": drives,
        }

    def figures(self, cell: Cell, drive: Drive) -> dict[str, Any]:
        """Solve one drive in every way.

        Returns
        -------
        dict
            ``filters``: of each, by its name, ``nees`` and ``ate_m``; and the ATE in metres of
            ``dead_reckoning_m``, ``batch_m`` and ``batch_with_walk_m``; and whether both batches
            ``converged``.
        """
        settings = replaced(self._slam_settings, estimator="robocentric")
        assert isinstance(settings, RobocentricSettings)
        recorded = record(drive, settings, self._prediction_settings, smooth=True)
        smoothed = recorded.smoothed
        assert smoothed is not None
        joint = solve(
            drive,
            replaced(
                settings,
                estimator="joint",
                velocity_noise_std=cell.velocity_noise_std,
                angular_velocity_noise_std=cell.angular_velocity_noise_std,
            ),
            self._prediction_settings,
        )
        truth = drive.ground_truth
        assert truth is not None
        problem = peer_problem(
            recorded,
            drive.camera,
            twist_noise=(cell.velocity_noise_std, cell.angular_velocity_noise_std),
            pixel_std=_PIXEL_STD,
        )
        estimate = recorded.trajectory
        walk = np.repeat([settings.velocity_walk_std, settings.angular_velocity_walk_std], 3)
        batch, converged = _batch(drive, problem, estimate, None)
        batch_with_walk, with_walk_converged = _batch(drive, problem, estimate, walk)
        return {
            "filters": {
                "robocentric": judged(truth, estimate),
                "smoothed": judged(truth, smoothed_trajectory(smoothed)),
                "joint": judged(truth, joint.trajectory),
            },
            "dead_reckoning_m": _ate(drive, joint.dead_reckoning),
            "batch_m": batch,
            "batch_with_walk_m": batch_with_walk,
            "converged": converged and with_walk_converged,
        }


def summary(drives: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Means over drives of one kind.

    Parameters
    ----------
    drives : sequence of dict
        As :meth:`MonteCarlo.figures` makes them.

    Returns
    -------
    list of dict
        Of each filter, ``nees`` with its ``nees_std_error``, ``ate_m``, and the ratio of that to
        the batch optimum's, ``to_batch``, and to that of the batch optimum which knows as much
        of motion as the robocentric filter does, ``to_batch_with_walk``; the number of
        ``drives``, and for how many of them the batches ``converged``.
    """
    batch, with_walk, reckoned = (
        float(np.mean([drive[name] for drive in drives]))
        for name in ("batch_m", "batch_with_walk_m", "dead_reckoning_m")
    )
    rows = []
    for name in drives[0]["filters"]:
        nees, ate = (
            np.array([drive["filters"][name][figure] for drive in drives])
            for figure in ("nees", "ate_m")
        )
        rows.append(
            {
                "name": name,
                "drives": len(drives),
                "nees": float(np.mean(nees)),
                "nees_std_error": std_error(nees),
                "ate_m": float(np.mean(ate)),
                "dead_reckoning_m": reckoned,
                "batch_m": batch,
                "to_batch": float(np.mean(ate)) / batch,
                "batch_with_walk_m": with_walk,
                "to_batch_with_walk": float(np.mean(ate)) / with_walk,
                "converged": sum(drive["converged"] for drive in drives),
            }
        )
    return rows


def spread(disparities: Array) -> dict[str, float]:
    """Median, twentieth part and share under :data:`SMALL_DISPARITY` of disparities, pixels."""
    return {
        "median_px": float(np.median(disparities)),
        "twentieth_px": float(np.quantile(disparities, 0.05)),
        "small_share": float(np.mean(disparities < SMALL_DISPARITY)),
    }


def std_error(values: Array) -> float | None:
    """Standard error of the mean; None of a single value."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None


def judged(reference: Trajectory, estimate: Trajectory) -> dict[str, float]:
    """NEES/6 and aligned ATE, metres, of an estimate with covariances."""
    figures = compare(reference, estimate, estimate.covariances)
    return {"nees": figures["nees_per_dof"], "ate_m": figures["ate_m"]["rmse"]}


def _name(cell: Cell) -> dict[str, float]:
    return {
        "velocity_noise_std": cell.velocity_noise_std,
        "angular_velocity_noise_std": cell.angular_velocity_noise_std,
        "frozen_share": cell.frozen_share,
    }


def _ate(drive: Drive, estimate: Trajectory) -> float:
    assert drive.ground_truth is not None
    return float(compare(drive.ground_truth, estimate)["ate_m"]["rmse"])


def _batch(
    drive: Drive, problem: PeerProblem, estimate: Trajectory, walk: Array | None
) -> tuple[float, bool]:
    """ATE of the batch optimum, and whether the search for it reached its end."""
    batch = BatchProblem(problem, walk)
    result = optimise(batch, batch.start(estimate.T_world_body), tolerance=_TOLERANCE)
    optimum = Trajectory.from_matrices(estimate.stamps, result.state.T_world_body)
    return _ate(drive, optimum), result.converged
