# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One row of the battery solved with one seed: its figures."""

import dataclasses
import functools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import threadpoolctl

from benchmark.battery.changes import quarter_of, with_clean_twist, with_sliding_tracks
from benchmark.battery.imaged import recorded_images, simulated_images
from benchmark.battery.mechanisms import mechanism_named
from benchmark.battery.rooms import FLIGHT, TAKE_OFF, WALK, simulate_in_room
from benchmark.battery.rows import (
    RECORDED_IMAGES,
    BatteryRow,
    Imaged,
    Recorded,
    Simulated,
    files_of,
)
from vislam_ros.core.filters import quantities
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.evaluation.relative import stretch_errors
from vislam_ros.data.loading import load_drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.run import Row
from vislam_ros.data.trajectory import Trajectory, read_tum
from vislam_ros.errors import VislamError

# A simulated drive's frames, and for how many of them a track is seen.
_STEPS, _MEAN_TRACK = 600, 13
_SECONDS = 60.0  # of a walk or a flight
_ROOMS = {"walk": WALK, "flight": FLIGHT, "take-off": TAKE_OFF}


@dataclass(frozen=True)
class Trial:
    """A row of the battery, and which of its subsets of tracks or draws of noise."""

    row: BatteryRow
    seed: int

    @property
    def key(self) -> str:
        """Name of the trial, which is all its own."""
        return f"{self.row.name}, seed {self.seed}"


@dataclass(frozen=True)
class TrialSettings:
    """What all trials share; ``without`` names a mechanism that is switched off."""

    data: Path
    slam: SlamSettings
    prediction: PredictionSettings
    smooth: bool = True
    without: str | None = None


def trials_of(rows: Sequence[BatteryRow], seeds: int) -> list[Trial]:
    """Each row with each seed, but once where nothing is drawn."""
    return [Trial(row, seed) for row in rows for seed in range(seeds if _draws(row) else 1)]


def _draws(row: BatteryRow) -> bool:
    """Whether a row has anything that is drawn."""
    if isinstance(row, Simulated):
        return True
    if isinstance(row, Imaged):
        return row.scene != RECORDED_IMAGES
    return row.percent < 100 or row.twist != "own" or row.sliding > 0


def run_trial(settings: TrialSettings, trial: Trial) -> Row:
    """Solve the row's drive; what goes wrong is the row's ``error``."""
    row: Row = {"key": trial.key, "error": None}
    begin = time.process_time()
    try:
        mechanism = mechanism_named(settings.without)
        slam = dataclasses.replace(settings.slam, **mechanism.settings)
        with threadpoolctl.threadpool_limits(1), mechanism.off():
            figures = _figures(dataclasses.replace(settings, slam=slam), trial)
        # JSON has no NaN and no infinity; such a figure is not known.
        row.update({k: None if _is_infinite(v) else v for k, v in figures.items()})
    except Exception as error:  # the others go on, and the row says why
        row["error"] = f"{type(error).__name__}: {error}"
    row["cpu_s"] = time.process_time() - begin
    return row


def _is_infinite(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _figures(settings: TrialSettings, trial: Trial) -> dict[str, Any]:
    drive, reference = drive_of(settings.data, trial)
    fraction = trial.row.percent / 100 if isinstance(trial.row, Recorded) else 1.0
    slam = dataclasses.replace(settings.slam, feature_fraction=fraction, seed=trial.seed)
    source = "gyro" if trial.row.gyro else None
    solution = solve(
        drive, slam, settings.prediction, motion_source=source, smooth=settings.smooth
    )
    estimates = {"estimate": solution.trajectory, "dead_reckoning": solution.dead_reckoning}
    if solution.smoothed is not None:
        estimates["smoothed"] = solution.smoothed
    figures: dict[str, Any] = {}
    for name, trajectory in estimates.items():
        if not np.isfinite(trajectory.positions).all():
            raise VislamError(f"{name} is not finite")
        i, j = associate(reference, trajectory)
        stretches = stretch_errors(reference.T_world_body[i], trajectory.T_world_body[j])
        figures[f"{name}_percent"] = 100.0 * float(np.mean(stretches.metres / stretches.lengths))
        figures[f"{name}_m"] = float(np.mean(stretches.metres))
        compared = compare(reference, trajectory, trajectory.covariances)
        figures[f"{name}_ate_m"] = compared["ate_m"]["rmse"]
        figures[f"{name}_nees"] = compared["nees_per_dof"]
    for axis in "xyz":
        column = f"{quantities.GYRO_BIAS.name}_{axis}"
        if column in solution.steps:
            figures[column] = float(solution.steps[column][-1])
    figures["verdict"] = solution.verdict.word.value if solution.verdict else None
    return figures


def drive_of(data: Path, trial: Trial) -> tuple[Drive, Trajectory]:
    """Drive and truth of a trial."""
    row, rng = trial.row, np.random.default_rng([trial.seed, 1])
    if isinstance(row, Simulated):
        drive = _simulated(row, trial.seed)
        assert drive.ground_truth is not None
        return drive, drive.ground_truth
    if isinstance(row, Imaged):
        if row.scene == RECORDED_IMAGES:
            return recorded_images(data)
        drive = simulated_images(row.scene, trial.seed, hard=row.hard)
        assert drive.ground_truth is not None
        return drive, drive.ground_truth
    drive, reference = _recorded(data, row.drive)
    if row.twist != "own":
        drive = with_clean_twist(drive, reference, rng, biased=row.twist == "clean, biased")
    if row.sliding:
        drive = with_sliding_tracks(drive, row.sliding / 100, rng)
    return (quarter_of(drive, row.quarter) if row.quarter else drive), reference


@functools.cache
def _recorded(data: Path, name: str) -> tuple[Drive, Trajectory]:
    drive, reference = files_of(data, name)
    return load_drive(drive), read_tum(reference)


def _simulated(row: Simulated, seed: int) -> Drive:
    share = row.sliding / 100
    if row.scene == "drive":
        velocity_std, turn_std = (0.5, 0.05) if row.noisy else (0.03, 0.003)
        return simulate(
            SimulationSettings(
                steps=_STEPS,
                landmarks=row.features * _STEPS // _MEAN_TRACK,
                velocity_noise_std=velocity_std,
                angular_velocity_noise_std=turn_std,
                outlier_share=share,
                seed=seed,
            )
        ).drive
    return simulate_in_room(
        _ROOMS[row.scene],
        features=row.features,
        rate=row.rate,
        seconds=_SECONDS,
        sliding_share=share,
        rng=np.random.default_rng([seed, row.features, row.rate, row.sliding]),
    )
