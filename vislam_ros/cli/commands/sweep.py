# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam sweep``: a grid or a Monte-Carlo of ``vislam solve``."""

import argparse
import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.grammar.paths import check_paths
from vislam_ros.cli.lines import answer, tell
from vislam_ros.cli.parameters import RunParameters, run_parameters
from vislam_ros.cli.reading import read_input
from vislam_ros.cli.screen import progress_bar, table_console
from vislam_ros.core.settings import settings_from_dict
from vislam_ros.data.files.parameter_file import parse_yaml
from vislam_ros.data.simulation.simulate import SimulationSettings
from vislam_ros.data.sweeps.file import SweepFile, read_sweep_file, swept_values
from vislam_ros.data.sweeps.log import RUNS, SweepLog, identity_of
from vislam_ros.data.sweeps.plan import SIMULATION, SweepPlan
from vislam_ros.data.sweeps.run import Row, SweepInputs
from vislam_ros.data.sweeps.sweeping import missing_runs, sweep
from vislam_ros.data.sweeps.table import PointResult, known_figures, value_text
from vislam_ros.data.sweeps.worker_pool import available_cores
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import SettingsError, VislamError, one_line

_COLUMNS = {
    "ate_m": ("ATE [m]", "{:.3f}"),
    "nees_per_dof": ("NEES/6", "{:.2f}"),
    "smoothed_ate_m": ("smoothed [m]", "{:.3f}"),
    "smoothed_nees_per_dof": ("smoothed NEES/6", "{:.2f}"),
    "dead_reckoning_ate_m": ("dead reckoning [m]", "{:.2f}"),
    "nis_per_dof": ("NIS/dof", "{:.2f}"),
    "rejected_fraction": ("rejected", "{:.1%}"),
    "wall_s": ("run [s]", "{:.1f}"),
}
_WITH_DEVIATION = ("ate_m", "nees_per_dof", "smoothed_ate_m", "smoothed_nees_per_dof")


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    described = _described(arguments)
    arguments.data, arguments.params = described.data, described.params
    check_paths(argparse.Namespace(**vars(arguments) | {"reference": described.reference}))
    parameters = run_parameters(arguments)
    plan = _plan(described, parameters)
    for note in plan.unused_notes():
        tell(f"warning: slam_node: {note}")
    inputs = _inputs(arguments, described, parameters)
    with SweepLog(arguments.out, identity_of(inputs), force=arguments.force) as log:
        points = _sweep(arguments, plan, inputs, log)
    _print_points(arguments.out, plan, points)
    if _print_failures(points) == len(plan.runs):
        raise VislamError(f"{arguments.out}: not one run ended well")
    return OK


def _described(arguments: argparse.Namespace) -> SweepFile:
    """What the file says, with the flags over it."""
    described = read_sweep_file(arguments.file) if arguments.file else SweepFile()
    given = {
        "data": arguments.data,
        "reference": arguments.reference,
        "params": arguments.params,
        "seeds": arguments.seeds and tuple(range(arguments.seeds)),
        "simulate": {} if arguments.simulate and described.simulate is None else None,
        "grid": {**described.grid, **{name: _values(name, text) for name, text in arguments.set}},
    }
    described = dataclasses.replace(
        described, **{name: value for name, value in given.items() if value is not None}
    )
    source = arguments.file or "sweep"
    if described.simulate is None and described.data is None:
        raise VislamError(f"{source}: names no drive: give DATA, --simulate or --file")
    if described.simulate is not None and (described.data or described.reference):
        raise VislamError(
            f"{source}: has a recorded drive or its truth and simulates, too: keep one of the two"
        )
    return described


def _values(name: str, text: str) -> tuple[object, ...]:
    """Values of ``--set NAME=V1,V2``, each as a parameter file writes it."""
    try:
        return swept_values(parse_yaml(f"[{text}]", "--set"))
    except (VislamError, TypeError) as error:
        raise VislamError(f"--set {name}={text}: these are no values with commas") from error


def _plan(described: SweepFile, parameters: RunParameters) -> SweepPlan:
    simulation = None
    if described.simulate is not None:
        values = dict(described.simulate)
        if "seed" in values:
            raise SettingsError(f"{SIMULATION}: seed: write seeds instead, beside {SIMULATION}")
        simulation = settings_from_dict(SimulationSettings, values)
    return SweepPlan(
        parameters.slam_values,
        parameters.prediction,
        simulation,
        described.grid,
        described.seeds or (0,),
    )


def _inputs(
    arguments: argparse.Namespace, described: SweepFile, parameters: RunParameters
) -> SweepInputs:
    given_map = parameters.given_map
    if described.simulate is not None:
        return SweepInputs(given_map=given_map, smooth=arguments.smooth)
    reference = read_trajectory(described.reference) if described.reference else None
    drive, *others = read_input(arguments, parameters.reading, parameters.tracker)
    if others:
        tell(f"note: only the first of {len(others) + 1} passes is solved")
    return SweepInputs(drive, reference or drive.ground_truth, given_map, arguments.smooth)


def _sweep(
    arguments: argparse.Namespace, plan: SweepPlan, inputs: SweepInputs, log: SweepLog
) -> Sequence[PointResult]:
    total, done = len(plan.runs), len(plan.runs) - len(missing_runs(plan, log))
    if done:
        tell(f"{done} of {total} runs are done already")
    with progress_bar("sweeping", total) as update:
        update(done, f"{done} of {total}")

        def count(row: Row) -> None:
            nonlocal done
            done += 1
            failed = f", failed: {row['error']}" if row["error"] else ""
            update(done, f"{done} of {total}{failed}")

        return sweep(
            plan,
            inputs,
            log,
            jobs=arguments.jobs or available_cores(),
            dask=arguments.dask,
            on_row=count,
        )


def _print_points(directory: Path, plan: SweepPlan, points: Sequence[PointResult]) -> None:
    """Print a line for each point; with several runs at one, their mean and deviation."""
    several = any(len(point.rows) > 1 for point in points)
    figures = [name for name in known_figures(points) if name in _COLUMNS]
    table = Table(title=Text(one_line(str(directory))), title_justify="left")
    short = [name.partition(".")[2] for name in plan.axes]
    for name, setting in zip(plan.axes, short, strict=True):
        table.add_column(Text(setting if short.count(setting) == 1 else name), justify="right")
    if several:
        table.add_column("runs", justify="right")
    for name in figures:
        table.add_column(Text(_COLUMNS[name][0]), justify="right", no_wrap=True)
    for point in points:
        cells = [value_text(point.point[name]) for name in plan.axes]
        if several:
            cells.append(str(len(point.rows)))
        cells.extend(_figure_text(name, point) for name in figures)
        table.add_row(*map(Text, cells))
    if figures:
        table_console().print(table)
    answer(f"{directory / 'table.csv'}, sweep.png, {RUNS}")


def _print_failures(points: Sequence[PointResult]) -> int:
    """Print each different error once; returns how many runs failed."""
    failures = [(error, point) for point in points for error in point.errors]
    counts = Counter(error for error, _ in failures)
    for error, point in dict(reversed(failures)).items():
        settings = [f"{name} = {value_text(value)}" for name, value in point.point.items()]
        where = f", first at {', '.join(settings)}" if settings else ""
        tell(f"failed: {counts[error]} runs{where}: {error}")
    return len(failures)


def _figure_text(name: str, point: PointResult) -> str:
    values, mean = point.values(name), point.mean(name)
    if mean is None:
        return "-"
    style = _COLUMNS[name][1]
    if len(values) < 2 or name not in _WITH_DEVIATION:
        return style.format(mean)
    return f"{style.format(mean)} ± {style.format(float(np.std(values)))}"
