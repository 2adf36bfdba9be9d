#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the estimate owes to each constant: one at a time is halved and doubled.

tools/sensitivity.py                            all constants, a quarter of an hour on two cores
tools/sensitivity.py --only track_noise         those whose name holds this
tools/sensitivity.py --seeds 20 --only _WIDER   with smaller standard errors

Each value is tried on simulated drives of several kinds and on the recorded drives that lie in
../shared/data or VISLAM_SHARED_DATA, whole and with a third of the tracks. An interrupted run
goes on where it was left. DIR holds rows of all trials, sensitivity.json and table.md.
"""

import argparse
import os
import sys
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from benchmark.machine import describe_machine
from benchmark.sensitivity.constants import CONSTANTS, Constant
from benchmark.sensitivity.drives import TrialDrive, recorded_drives, simulated_drives
from benchmark.sensitivity.summary import markdown, summary
from benchmark.sensitivity.trials import TrialSettings, run_trial, trials_of

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.cli.grammar.shared import NO_OVERRIDES
from vislam_ros.cli.parameters import run_parameters
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.data.sweeps.log import SweepLog
from vislam_ros.data.sweeps.run import Row
from vislam_ros.data.sweeps.worker_pool import available_cores, in_processes
from vislam_ros.errors import VislamError

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED_DATA = Path(os.environ.get("VISLAM_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))

# With --quick, of the simulated drives' steps.
_SHORTER = 6


def main(argv: list[str] | None = None) -> int:
    """Try, print and write; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        results = measure(arguments)
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print(f"interrupted: the same call goes on from {arguments.out}", file=sys.stderr)
        return INTERRUPTED
    print(markdown(results), end="")
    for result in results:
        for failure in result["failed"]:
            print(f"{result['constant']} = {result['value']}: {failure}", file=sys.stderr)
    return OK


def measure(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Run the trials that are missing, and write what all of them say."""
    constants = _chosen(arguments.only)
    drives = simulated_drives(arguments.seeds, _SHORTER if arguments.quick else 1)
    if not arguments.simulated:
        drives += recorded_drives(sorted(arguments.data.glob("*.npz")))
    parameters = run_parameters(arguments)
    settings = TrialSettings(parameters.slam, parameters.prediction)
    with SweepLog(
        arguments.out, _identity(settings, quick=arguments.quick), force=arguments.force
    ) as log:
        missing = [trial for trial in trials_of(constants, drives) if trial.key not in log.rows]
        outcomes = in_processes(run_trial, settings, missing, arguments.jobs)
        with progress_bar("trials", len(missing)) as update, closing(outcomes):
            for done, (_, outcome) in enumerate(outcomes, start=1):
                if isinstance(outcome, Exception):
                    raise VislamError(f"a process ended: {outcome}")
                log.append(outcome)
                update(done, outcome["key"])
        results = summary(constants, drives, log.rows)
    _write(arguments.out, results, drives, log.rows)
    return results


def _write(
    directory: Path,
    results: list[dict[str, Any]],
    drives: list[TrialDrive],
    rows: Mapping[str, Row],
) -> None:
    report = {
        "machine": describe_machine(),
        "drives": [drive.name for drive in drives],
        "values": {constant.key: constant.value for constant in CONSTANTS},
        "cpu_s": sum(row.get("cpu_s", 0.0) for row in rows.values()),
        "results": results,
    }
    write_json(directory / "sensitivity.json", report)
    replace_file(directory / "table.md", markdown(results).encode("utf-8"))


def _identity(settings: TrialSettings, *, quick: bool) -> dict[str, Any]:
    """What makes two runs one: the values as they stand, and drives of the same length."""
    values = {constant.key: str(constant.value) for constant in CONSTANTS}
    return {"settings": repr(settings), "values": values, "quick": quick}


def _chosen(part: str) -> list[Constant]:
    chosen = [constant for constant in CONSTANTS if part in constant.key]
    if not chosen:
        raise VislamError(f"--only {part}: no constant's name holds this")
    return chosen


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--only", default="", metavar="PART", help="constants whose name holds this")
    add("--seeds", type=int, default=2, metavar="N", help="simulated drives of each kind (2)")
    add("--data", type=Path, default=SHARED_DATA, metavar="DIR", help="where recorded drives lie")
    add("--simulated", action="store_true", help="leave the recorded drives out")
    add("--quick", action="store_true", help="short drives, to see that all works")
    add("--params", type=Path, metavar="FILE", help="ROS parameter file (config/ekf.yaml)")
    add("--jobs", type=int, default=available_cores(), metavar="N", help="processes (all cores)")
    add("--out", type=Path, default=Path("sensitivity"), metavar="DIR", help="(sensitivity)")
    add("--force", action="store_true", help="begin anew")
    parser.set_defaults(**{**NO_OVERRIDES, "estimator": "robocentric"})
    return parser


if __name__ == "__main__":
    sys.exit(main())
