# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Holes in a drive: the estimate is held against what is left across each of them.

tools/faults.py outages drive.npz --reference truth.tum
tools/faults.py outages drive.npz --reference truth.tum --seconds 2 --places 3
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from reliability.outages import KINDS, OutageRow, measure_outages, outages
from reliability.output import add_output, write_output
from vislam_ros.cli.exit_codes import OK
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.files.whole_file import refuse_existing
from vislam_ros.data.loading import load_drive
from vislam_ros.data.trajectory import read_tum

_OUT = Path("results") / "outages.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("data", type=Path, metavar="DATA_OR_BAG")
    add("--reference", type=Path, required=True, metavar="REF.tum")
    add("--seconds", type=float, nargs="+", default=[1.0, 2.0, 5.0], help="of each hole (1 2 5)")
    add("--places", type=int, default=10, help="where holes begin, spread over the drive (10)")
    add_output(parser, _OUT)


def run_command(arguments: argparse.Namespace) -> int:
    """Solve a drive with each of the holes, and print what they cost."""
    refuse_existing(arguments.out, force=arguments.force)
    drive, reference = load_drive(arguments.data), read_tum(arguments.reference)
    tasks = outages(arguments.places, arguments.seconds)
    rows = {}
    for row in measure_outages(
        drive, reference, RobocentricSettings(), PredictionSettings(), tasks
    ):
        rows[row.outage] = row
        print(f"{len(rows)} of {len(tasks)}", end="\r", file=sys.stderr)
    write_output(arguments.out, [rows[task].as_dict() for task in tasks])
    print_table([rows[task] for task in tasks])
    return OK


def print_table(rows: list[OutageRow]) -> None:
    """A line for each kind and length of hole."""
    print(
        "| missing | s | holds | worst gap, m | beside it "
        "| ATE ratio | worst | beside it | NEES, worst |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in KINDS:
        for seconds in sorted({row.outage.seconds for row in rows}):
            some = [r for r in rows if r.outage.kind == kind and r.outage.seconds == seconds]
            worst = max(some, key=lambda row: row.gap_m)
            ratio = float(np.median([row.ate_ratio for row in some]))
            farthest = max(some, key=lambda row: row.ate_ratio)
            print(
                f"| {kind} | {seconds:g} | {sum(row.holds for row in some)} of {len(some)} "
                f"| {worst.gap_m:.2f} | {worst.beside_m:.2f} | {ratio:.2f} "
                f"| {farthest.ate_ratio:.2f} | {farthest.beside_ate_ratio:.2f} "
                f"| {max(row.nees_ratio for row in some):.2f} |"
            )
