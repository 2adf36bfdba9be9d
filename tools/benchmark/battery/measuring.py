# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The battery from its rows to its files, going on where an earlier call was left."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import vislam_ros.core
import vislam_ros.data
from benchmark import recorded_drive
from benchmark.battery import changes, mechanisms, rooms, rows, trials
from benchmark.battery.markdown import markdown
from benchmark.battery.picture import draw_battery
from benchmark.battery.rows import BatteryRow
from benchmark.battery.summary import failures, summed_groups, summed_rows
from benchmark.battery.trials import Trial, TrialSettings, run_trial, trials_of
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.data.sweeps.log import IDENTITY, RUNS, SweepLog
from vislam_ros.data.sweeps.run import Row
from vislam_ros.data.sweeps.worker_pool import in_processes
from vislam_ros.errors import VislamError

#: What the battery adds to the files of its log.
TABLE, PICTURE = "table.md", "battery.png"

# What decides a trial's figures, besides its settings.
_PACKAGES = (vislam_ros.core, vislam_ros.data)
_MODULES = (recorded_drive, changes, mechanisms, rooms, rows, trials)


@dataclass(frozen=True)
class Battery:
    """What a battery found.

    Attributes
    ----------
    rows, groups : list of dict
        See :mod:`benchmark.battery.summary`.
    notes : list of str
        Rows that are left out, trials that failed.
    """

    rows: list[dict[str, Any]]
    groups: list[dict[str, Any]]
    notes: list[str]


def measure_battery(
    directory: Path,
    chosen: Sequence[BatteryRow],
    settings: TrialSettings,
    *,
    seeds: int,
    jobs: int,
    force: bool,
    beside: Path | None = None,
) -> Battery:
    """Run the trials that have no row yet, and write what all of them say.

    Parameters
    ----------
    directory : Path
        Keeps the rows of trials, ``table.md`` and ``battery.png``.
    chosen : sequence of BatteryRow
        Those whose drive is missing are left out.
    settings : TrialSettings
    seeds : int
        Of each row in which anything is drawn.
    jobs : int
        Processes at a time.
    force : bool
        Begin anew where the directory's rows are of other settings or other code.
    beside : Path, optional
        Directory of another battery, whose errors are put beside.

    Raises
    ------
    VislamError
        Where a directory is not what it should be, or a process was killed.
    """
    others = read_rows(beside) if beside else None
    solvable, missing = rows.available(chosen, settings.data)
    todo = trials_of(solvable, seeds)
    with _log(directory, _identity(settings), force=force) as log:
        _run(log, settings, [trial for trial in todo if trial.key not in log.rows], jobs)
        found = dict(log.rows)
    summed = summed_rows(solvable, todo, found, others)
    left_out = [
        f"battery: {name} is not in {settings.data}: its rows are left out" for name in missing
    ]
    notes = left_out + [f"battery: failed: {text}" for text in failures(todo, found)]
    battery = Battery(summed, summed_groups(summed), notes)
    replace_file(directory / TABLE, markdown(battery.rows, battery.groups, notes).encode("utf-8"))
    replace_file(directory / PICTURE, draw_battery(battery.rows))
    return battery


def read_rows(directory: Path) -> dict[str, Row]:
    """Read the rows of trials from a battery's directory, by their keys.

    Raises
    ------
    VislamError
        Where it is none, or a line is damaged.
    """
    path = directory / RUNS
    found: dict[str, Row] = {}
    for number, line, is_whole in read_lines(path, "the other battery"):
        if not is_whole:
            continue
        try:
            row = json.loads(line)
            found[row["key"]] = row
        except (ValueError, KeyError, TypeError) as error:
            raise VislamError(f"{path}, line {number}: not the row of a trial") from error
    return found


def _run(log: SweepLog, settings: TrialSettings, missing: Sequence[Trial], jobs: int) -> None:
    outcomes = in_processes(run_trial, settings, missing, jobs)
    with progress_bar("battery", len(missing)) as update, closing(outcomes):
        for done, (index, outcome) in enumerate(outcomes, start=1):
            if isinstance(outcome, Exception):
                raise VislamError(f"{missing[index].key}: its process ended: {outcome}")
            log.append(outcome)
            update(done, outcome["key"])


def _log(directory: Path, identity: Mapping[str, Any], *, force: bool) -> SweepLog:
    there = directory / IDENTITY
    is_ours = not there.is_file() or _content(there) == identity
    if not (is_ours or force):
        raise VislamError(
            f"{directory}: holds rows of other settings or other code: choose another --out, or "
            "add --force to begin anew"
        )
    return SweepLog(directory, dict(identity), force=force and not (is_ours and there.is_file()))


def _content(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except ValueError:
        return None


def _identity(settings: TrialSettings) -> dict[str, Any]:
    """What makes two batteries one: settings and code."""
    chosen = settings.slam, settings.prediction, settings.smooth, settings.without
    return {"settings": repr(chosen), "code": _digest_of_code()}


def _digest_of_code() -> str:
    folders = [Path(folder) for package in _PACKAGES for folder in package.__path__]
    modules = [Path(str(module.__file__)) for module in _MODULES]
    content = hashlib.sha256()
    for path in modules + [path for folder in folders for path in sorted(folder.rglob("*.py"))]:
        content.update(path.name.encode())
        content.update(path.read_bytes())
    return content.hexdigest()
