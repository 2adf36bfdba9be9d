# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Our filter and GTSAM's estimators on the same tracks: the time of a step and the error."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.peers.gtsam_factors import Recipe
from benchmark.peers.gtsam_runs import (
    PeerFailure,
    PeerRun,
    gtsam_is_installed,
    run_batch,
    run_fixed_lag,
    run_isam2,
)
from benchmark.peers.problem import PeerProblem, peer_problem
from benchmark.recorded_drive import (
    RecordedDrive,
    given_gyro_bias,
    record,
)
from vislam_ros.core.noise.twist_noise import white_noise_levels
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

# From all tracks down; the first one with which a peer reaches the end is taken.
_LADDER = (Recipe(1.0), Recipe(1.0, 1.0), Recipe(4.0, 1.0), Recipe(8.0, 1.0))
# With landmarks of less disparity iSAM2 has not ended 3000 steps after eight minutes.
_SHORT_LADDER = _LADDER[2:]
# The batch begins near its end, so its priors need only keep landmarks from infinity.
_BATCH_LADDER = (Recipe(1.0, 30.0), Recipe(4.0, 30.0), Recipe(8.0, 30.0))

_Run = Callable[[PeerProblem, Recipe, Array | None], PeerRun]


class PeerComparison:
    """Solves a drive with our filter, then gives peers what it had.

    Parameters
    ----------
    drive : Drive
    reference : Trajectory
    slam_settings, prediction_settings : SlamSettings, PredictionSettings
    pixel_std : float
        Noise of a pixel coordinate that the peers are given.
    on_progress : callable
        Called with what is run next.
    """

    def __init__(
        self,
        drive: Drive,
        reference: Trajectory,
        slam_settings: SlamSettings,
        prediction_settings: PredictionSettings,
        *,
        pixel_std: float = 1.0,
        on_progress: Callable[[str], None],
    ):
        self._reference = reference
        self._on_progress = on_progress
        self._name = slam_settings.estimator
        on_progress(f"{self._name} on {drive.steps} steps")
        self._recorded = record(drive, slam_settings, prediction_settings)
        self._twist_noise = white_noise_levels(drive.twists)
        self._pixel_std = pixel_std
        self._bias = given_gyro_bias(drive, reference)
        self._problem = peer_problem(
            self._recorded, drive.camera, twist_noise=self._twist_noise, pixel_std=pixel_std
        )

    def run(self, *, every: bool = True) -> dict[str, Any]:
        """Run the peers; return what they were given, and a row for each run.

        Parameters
        ----------
        every : bool
            Whether all of them run, with all tracks where they can. Without it, those are left
            out that are too slow for a drive of some thousand steps (iSAM2 with landmarks under
            4 px, without a bias, with covariances, with careful relinearisation), and the batch
            without a bias.
        """
        own = self._own_row(self._recorded)
        rows = [own]
        if gtsam_is_installed():
            rows += self._peer_rows(every)
            for row in rows:
                if row.get("step_ms"):
                    row["times_ours"] = row["step_ms"] / own["step_ms"]
        return {
            "steps": self._problem.steps,
            "given_velocity_noise_std": self._twist_noise[0],
            "given_angular_velocity_noise_std": self._twist_noise[1],
            "given_pixel_noise_std": self._pixel_std,
            "given_gyro_bias": self._bias.tolist(),
            "runs": rows,
        }

    def _peer_rows(self, every: bool) -> list[dict[str, Any]]:
        bias = self._bias
        ladder = _LADDER if every else _SHORT_LADDER
        runs: list[tuple[str, Sequence[Recipe], _Run, Array | None]] = [
            ("isam2, bias given", ladder, run_isam2, bias),
            ("isam2, bias given, near landmarks", _LADDER[-1:], run_isam2, bias),
        ]
        if every:
            covariance = functools.partial(run_isam2, covariance=True)
            careful = functools.partial(run_isam2, careful=True)
            runs += [
                ("isam2", ladder, run_isam2, None),
                ("isam2, bias given, with covariance", ladder, covariance, bias),
                ("isam2, bias given, relinearised carefully", _SHORT_LADDER, careful, bias),
            ]
        rows = [self._first_that_lasts(*run)[0] for run in runs]
        row, lagging = self._first_that_lasts(
            "fixed lag of 2 s, bias given", _LADDER, run_fixed_lag, bias
        )
        rows.append(row)
        starts = [self._recorded.trajectory.T_world_body]
        if lagging is not None and lagging.online is not None:
            starts.append(lagging.online)

        def run_batches(
            problem: PeerProblem, recipe: Recipe, gyro_bias: Array | None = None
        ) -> PeerRun:
            """Optimise from each start and take the lowest cost: one may lie in a false valley."""
            runs = [run_batch(problem, recipe, start, gyro_bias) for start in starts]
            return min(runs, key=lambda run: np.inf if run.cost is None else run.cost)

        for name, given in (("batch, bias given", bias), ("batch", None))[: 2 if every else 1]:
            rows.append(self._first_that_lasts(name, _BATCH_LADDER, run_batches, given)[0])
        return rows

    def _first_that_lasts(
        self,
        name: str,
        ladder: Sequence[Recipe],
        run: _Run,
        gyro_bias: Array | None,
    ) -> tuple[dict[str, Any], PeerRun | None]:
        """Try recipes in turn; return a row, and the run of the first that reached the end."""
        failures = []
        for recipe in ladder:
            self._on_progress(f"{name}: {recipe}")
            try:
                result = run(self._problem, recipe, gyro_bias)
            except PeerFailure as error:
                failures.append(f"{recipe}: {error}")
                continue
            return {**self._row(name, result), "recipe": str(recipe), "failed": failures}, result
        return {"name": name, "recipe": None, "failed": failures}, None

    def _row(self, name: str, run: PeerRun) -> dict[str, Any]:
        milliseconds = run.update_seconds * 1e3
        steps = self._problem.steps
        one_by_one = len(milliseconds) == steps
        return {
            "name": name,
            "step_ms": float(milliseconds.sum()) / steps,
            "step_ms_last_quarter": _last_quarter(milliseconds) if one_by_one else None,
            "step_ms_max": float(milliseconds.max()) if one_by_one else None,
            "total_s": float(milliseconds.sum()) * 1e-3,
            "build_ms": run.build_seconds * 1e3 / steps,
            "ate_online_m": None if run.online is None else self._ate(run.online),
            "ate_final_m": None if run.final is None else self._ate(run.final),
            "landmarks": run.landmarks,
            "observations": run.observations,
            "iterations": run.iterations,
        }

    def _own_row(self, recorded: RecordedDrive) -> dict[str, Any]:
        milliseconds = recorded.step_seconds * 1e3
        return {
            "name": self._name,
            "step_ms": float(milliseconds.mean()),
            "step_ms_last_quarter": _last_quarter(milliseconds),
            "step_ms_max": float(milliseconds.max()),
            "total_s": float(milliseconds.sum()) * 1e-3,
            "ate_online_m": self._error(recorded.trajectory),
            "landmarks": recorded.steps[-1].landmarks,
            "observations": sum(step.used + step.admitted for step in recorded.steps),
        }

    def _ate(self, poses: Array) -> float:
        stamps = self._recorded.trajectory.stamps
        return self._error(Trajectory.from_matrices(stamps, poses))

    def _error(self, trajectory: Trajectory) -> float:
        return float(compare(self._reference, trajectory)["ate_m"]["rmse"])


def _last_quarter(milliseconds: Array) -> float:
    return float(np.mean(np.array_split(milliseconds, 4)[-1]))
