#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Solve a drive with holes in it, and hold the estimate against what is left across each hole.

tools/faults.py drive.npz --reference truth.tum
tools/faults.py drive.npz --reference truth.tum --seconds 2 --places 3 --out results/outages.json

tools/faults.py signals sends signals to the processes of a live run instead.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from reliability import signals_command
from reliability.outages import KINDS, OutageRow, measure_outages, outages

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.loading import load_drive
from vislam_ros.data.trajectory import read_tum
from vislam_ros.errors import VislamError

OUT = Path("results") / "outages.json"


def measure(arguments: argparse.Namespace) -> list[OutageRow]:
    """Rows of all the holes that are asked for, in their order."""
    refuse_existing(arguments.out, force=arguments.force)
    drive, reference = load_drive(arguments.data), read_tum(arguments.reference)
    tasks = outages(arguments.places, arguments.seconds)
    rows = {}
    for row in measure_outages(
        drive, reference, RobocentricSettings(), PredictionSettings(), tasks
    ):
        rows[row.outage] = row
        print(f"{len(rows)} of {len(tasks)}", end="\r", file=sys.stderr)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    content = [rows[task].as_dict() for task in tasks]
    replace_file(arguments.out, (json.dumps(content, indent=1) + "\n").encode())
    return [rows[task] for task in tasks]


def print_table(rows: list[OutageRow]) -> None:
    """A line for each kind and length of hole."""
    print("| missing | s | holds | worst gap, m | beside it | ATE ratio | worst | NEES, worst |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in KINDS:
        for seconds in sorted({row.outage.seconds for row in rows}):
            some = [r for r in rows if r.outage.kind == kind and r.outage.seconds == seconds]
            worst = max(some, key=lambda row: row.gap_m)
            ratios = [row.ate_ratio for row in some]
            print(
                f"| {kind} | {seconds:g} | {sum(row.holds for row in some)} of {len(some)} "
                f"| {worst.gap_m:.2f} | {worst.beside_m:.2f} | {np.median(ratios):.2f} "
                f"| {max(ratios):.2f} | {max(row.nees_ratio for row in some):.2f} |"
            )


def main() -> int:
    """Run the command."""
    if sys.argv[1:2] == ["signals"]:
        signals = argparse.ArgumentParser(prog="faults.py signals")
        signals_command.add_arguments(signals)
        try:
            return signals_command.run_command(signals.parse_args(sys.argv[2:]))
        except VislamError as error:
            print(f"error: {error}", file=sys.stderr)
            return FAILED
        except KeyboardInterrupt:
            return INTERRUPTED
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("data", type=Path, metavar="DATA_OR_BAG")
    add("--reference", type=Path, required=True, metavar="REF.tum")
    add("--seconds", type=float, nargs="+", default=[1.0, 2.0, 5.0], help="of each hole (1 2 5)")
    add("--places", type=int, default=10, help="where holes begin, spread over the drive (10)")
    add("--out", type=Path, default=OUT, metavar="FILE", help=f"({OUT})")
    add("--force", action="store_true", help="replace FILE")
    try:
        print_table(measure(parser.parse_args()))
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    return OK


if __name__ == "__main__":
    sys.exit(main())
