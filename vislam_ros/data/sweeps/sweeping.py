# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sweep from its plan to its table and picture, going on where an earlier call was left."""

from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing

from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.data.sweeps.log import SweepLog
from vislam_ros.data.sweeps.plan import SweepPlan, SweepRun
from vislam_ros.data.sweeps.run import Row, SweepInputs, execute, row_start
from vislam_ros.data.sweeps.table import PointResult, gather, table_csv
from vislam_ros.data.sweeps.worker_pool import in_processes, on_dask


def missing_runs(plan: SweepPlan, log: SweepLog) -> list[SweepRun]:
    """Return the runs of a plan that have no row yet, or had none to give (see :func:`sweep`)."""
    return [
        run for run in plan.runs if log.rows.get(run.key, {"unfinished": True}).get("unfinished")
    ]


def sweep(
    plan: SweepPlan,
    inputs: SweepInputs,
    log: SweepLog,
    *,
    jobs: int,
    dask: str | None = None,
    on_row: Callable[[Row], None] | None = None,
) -> list[PointResult]:
    """Do the runs that are missing, then write ``table.csv`` and ``sweep.png``.

    A run that fails is a row with its error. One that had no chance to fail, since its process
    was killed or its worker lacks this package, is ``unfinished`` too: the next call repeats it.

    Parameters
    ----------
    plan : SweepPlan
    inputs : SweepInputs
    log : SweepLog
        Has each row as soon as its run ends.
    jobs : int
        Processes at a time.
    dask : str, optional
        Scheduler of a Dask cluster that does the runs instead.
    on_row : callable, optional
        Hears each row.

    Returns
    -------
    list of PointResult
        In the order of the plan, whatever order the runs ended in.
    """
    missing = missing_runs(plan, log)
    outcomes = (
        in_processes(execute, inputs, missing, jobs)
        if dask is None
        else on_dask(execute, inputs, missing, dask)
    )
    with closing(outcomes):
        for index, outcome in outcomes:
            row = (
                _unfinished(missing[index], outcome) if isinstance(outcome, Exception) else outcome
            )
            log.append(row)
            if on_row:
                on_row(row)
    points = gather(plan.runs, log.rows)
    # It takes a second to import, which what cannot be read need not wait for.
    from vislam_ros.data.sweeps.plot import draw_sweep, picture_bytes

    replace_file(log.directory / "table.csv", table_csv(points).encode())
    replace_file(log.directory / "sweep.png", picture_bytes(draw_sweep(plan, points)))
    return points


def _unfinished(run: SweepRun, error: Exception) -> Row:
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, BrokenProcessPool):
        text = "its process was killed: is there memory enough? try fewer --jobs"
    return {**row_start(run), "error": text, "unfinished": True}
