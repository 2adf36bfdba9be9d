# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One run of a sweep, in whatever process: settings in, a row of plain values out."""

import math
import time
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import threadpoolctl

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import Solution, solve
from vislam_ros.data.sweeps.plan import SweepRun
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

#: Column -> value, as a line of JSON holds it.
Row = dict[str, Any]

_OF_SUMMARY = (
    "steps",
    "frozen_steps",
    "landmarks",
    "rejected_fraction",
    "nis_per_dof",
    "step_ms_p50",
)


@dataclass(frozen=True)
class SweepInputs:
    """What all runs share.

    Attributes
    ----------
    drive : Drive or None
        None where each run simulates its own.
    reference : Trajectory or None
        The truth about the drive, where it is known.
    given_map : LandmarkMap or None
        The map of the estimator ``localization``.
    smooth : bool
        Whether the runs smooth their drive, too.
    """

    drive: Drive | None = None
    reference: Trajectory | None = None
    given_map: LandmarkMap | None = None
    smooth: bool = False


def row_start(run: SweepRun) -> Row:
    """Columns that tell which run a row is of."""
    return {"key": run.key, **run.point, "seed": run.seed}


def execute(inputs: SweepInputs, run: SweepRun) -> Row:
    """Do a run; whatever goes wrong in it is its row's ``error``."""
    row = row_start(run)
    started = time.monotonic()
    try:
        with threadpoolctl.threadpool_limits(1):
            figures = _figures(inputs, run)
        # JSON has no NaN and no infinity; such a figure is not known.
        row.update({k: v if v is None or math.isfinite(v) else None for k, v in figures.items()})
        row["error"] = None
    except Exception as error:  # the sweep goes on, and the row tells
        kind = "" if isinstance(error, VislamError) else f"{type(error).__name__}: "
        row["error"] = f"{kind}{error}"
    row["wall_s"] = time.monotonic() - started
    return row


def _figures(inputs: SweepInputs, run: SweepRun) -> dict[str, float | None]:
    drive, reference = inputs.drive, inputs.reference
    if run.simulation is not None:
        drive = simulate(run.simulation).drive
        reference = drive.ground_truth
    assert drive is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the row tells
        solution = solve(
            drive, run.slam, run.prediction, given_map=inputs.given_map, smooth=inputs.smooth
        )
    if not len(solution.trajectory):
        raise VislamError(solution.summary["incomplete_reason"])
    figures = _step_figures(solution)
    if reference is not None:
        errors = compare(reference, solution.trajectory, solution.trajectory.covariances)
        figures["ate_m"] = errors["ate_m"]["rmse"]
        figures["rpe_frame_m"] = errors["rpe_frame_m"]["rmse"]
        figures["nees_per_dof"] = errors["nees_per_dof"]
        errors = compare(reference, solution.dead_reckoning)
        figures["dead_reckoning_ate_m"] = errors["ate_m"]["rmse"]
        if solution.smoothed is not None:
            errors = compare(reference, solution.smoothed, solution.smoothed.covariances)
            figures["smoothed_ate_m"] = errors["ate_m"]["rmse"]
            figures["smoothed_nees_per_dof"] = errors["nees_per_dof"]
    return figures


def _step_figures(solution: Solution) -> dict[str, float | None]:
    """Figures that need no truth."""
    finite = np.isfinite(solution.trajectory.positions).all(axis=1)
    if not finite.all():
        raise VislamError(f"the estimate is not finite from step {int(np.argmin(finite))} on")
    return {name: solution.summary[name] for name in _OF_SUMMARY}
