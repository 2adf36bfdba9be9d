# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One drive estimated with one constant at another value: a row of figures."""

import functools
import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmark.sensitivity.constants import Constant, Value
from benchmark.sensitivity.drives import LoadedDrive, TrialDrive, load
from benchmark.sensitivity.varied import varied
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import LONG_DELTA, compare
from vislam_ros.data.simulation.simulated_drive import SimulatedLandmarks
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.run import Row

# One landmark in a hundred is farther from its place than this, in squares, if its covariance is
# true: chi-square with three degrees of freedom.
_OUTSIDE = 11.345


@dataclass(frozen=True)
class Trial:
    """A drive, and the constant that has another value; None for the values as they stand."""

    drive: TrialDrive
    constant: Constant | None = None
    value: Value | None = None

    @property
    def key(self) -> str:
        """Name of the trial, which is all its own."""
        constant = f"{self.constant.key} = {self.value}" if self.constant else "as is"
        return f"{constant}: {self.drive.name}"


@dataclass(frozen=True)
class TrialSettings:
    """What all trials share."""

    slam: SlamSettings
    prediction: PredictionSettings


def trials_of(constants: Sequence[Constant], drives: Sequence[TrialDrive]) -> list[Trial]:
    """Every drive with all values as they stand, then with each value of each constant."""
    varied_trials = [
        Trial(drive, constant, value)
        for constant in constants
        for value in constant.values
        for drive in drives
    ]
    return [Trial(drive) for drive in drives] + varied_trials


def run_trial(settings: TrialSettings, trial: Trial) -> Row:
    """Estimate the drive; what goes wrong is the row's ``error``."""
    row: Row = {"key": trial.key, "error": None}
    begin = time.process_time()
    try:
        row.update(_figures(settings, trial))
    except Exception as error:  # the others go on, and the row says why
        row["error"] = f"{type(error).__name__}: {error}"
    row["cpu_s"] = time.process_time() - begin
    return row


def _figures(settings: TrialSettings, trial: Trial) -> dict[str, Any]:
    constant, value = trial.constant, trial.value
    if constant is None or value is None:
        return _as_is(settings, trial.drive)
    if constant.is_setting:
        changes: dict[str, Any] = {constant.name: value}
        slam = replace(settings.slam, **changes)
        return _judged(_loaded(trial.drive), replace(settings, slam=slam), trial.drive)
    with varied(constant, value):
        if not constant.is_of_loading:
            return _judged(_loaded(trial.drive), settings, trial.drive)
        loaded = load(trial.drive)
    # Mostly the drive is read as before, and then all that follows is known.
    if _are_same(loaded.drive, _loaded(trial.drive).drive):
        return _as_is(settings, trial.drive)
    return _judged(loaded, settings, trial.drive)


@functools.cache
def _loaded(trial_drive: TrialDrive) -> LoadedDrive:
    return load(trial_drive)


@functools.cache
def _as_is(settings: TrialSettings, trial_drive: TrialDrive) -> dict[str, Any]:
    return _judged(_loaded(trial_drive), settings, trial_drive)


def _are_same(a: Drive, b: Drive) -> bool:
    """Whether a drive was read twice in the same way."""
    return a.camera == b.camera and np.array_equal(a.twists, b.twists)


def _judged(
    loaded: LoadedDrive, settings: TrialSettings, trial_drive: TrialDrive
) -> dict[str, Any]:
    """Solve a drive and compare it with the truth."""
    slam = replace(settings.slam, feature_fraction=trial_drive.feature_fraction)
    solution = solve(loaded.drive, slam, settings.prediction)
    trajectory = solution.trajectory
    errors = compare(loaded.truth, trajectory, trajectory.covariances)
    long_errors = errors[f"rpe_{LONG_DELTA:.0f}m_m"]
    poses = np.hstack([trajectory.positions, trajectory.quaternions])
    figures = {
        "sha256": hashlib.sha256(poses.tobytes()).hexdigest(),
        "error_percent": 100 * long_errors["mean"] / LONG_DELTA if long_errors else None,
        "ate_m": errors["ate_m"]["rmse"],
        "nees": errors["nees_per_dof"],
        "landmarks": len(solution.landmarks),
    }
    if loaded.landmarks is not None:
        figures["outside_percent"] = _outside_percent(solution.landmarks, loaded.landmarks)
    return figures


def _outside_percent(found: LandmarkMap, true: SimulatedLandmarks) -> float | None:
    """Share of the landmarks outside the region that should hold all but one per cent."""
    place_of = {
        point: row for row, point in enumerate(zip(true.ids, true.generations, strict=True))
    }
    points = list(zip(found.ids, found.generations, strict=True))
    rows = np.array([place_of.get(point, -1) for point in points], dtype=np.int64)
    known = (rows >= 0) & ~true.sliding[rows]
    if not known.any():
        return None
    error = (found.positions[known] - true.positions[rows[known]])[..., None]
    squared = np.sum(error * np.linalg.solve(found.covariances[known], error), axis=(1, 2))
    return 100 * float(np.mean(squared > _OUTSIDE))
