#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a drive costs when messages are missing or wrong.

tools/faults.py outages drive.npz --reference truth.tum
tools/faults.py outages drive.npz --reference truth.tum --seconds 2 --places 3
tools/faults.py topics
tools/faults.py topics --streams twist features --out results/topics.json
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from reliability.outages import KINDS, OutageRow, measure_outages, outages
from reliability.topic_faults import STREAMS, all_faults
from reliability.topic_trials import TrialRow, measure_topic_faults

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.loading import load_drive
from vislam_ros.data.trajectory import read_tum
from vislam_ros.errors import VislamError

RESULTS = Path("results")
ALL_STREAMS = (*STREAMS, "calibration")


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
    _write(arguments.out, [rows[task].as_dict() for task in tasks])
    return [rows[task] for task in tasks]


def _write(file: Path, content: list[dict[str, Any]]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    replace_file(file, (json.dumps(content, indent=1) + "\n").encode())


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


def run_outages(arguments: argparse.Namespace) -> int:
    """Solve a drive with holes, and hold it against what is left across each."""
    print_table(measure(arguments))
    return OK


def run_topics(arguments: argparse.Namespace) -> int:
    """Send each fault once to the nodes, and hold their answers against an offline estimate."""
    refuse_existing(arguments.out, force=arguments.force)
    faults = [
        fault
        for fault in all_faults()
        if fault.stream in arguments.streams
        and (arguments.kinds is None or fault.kind in arguments.kinds)
    ]
    rows = []
    for row in measure_topic_faults(faults):
        rows.append(row)
        print(f"{len(rows)} of {len(faults)}", end="\r", file=sys.stderr)
        if not row.holds:
            print(f"does not hold: {row}", file=sys.stderr)
    _write(arguments.out, [row.as_dict() for row in rows])
    print_topics(rows)
    return OK if all(row.holds for row in rows) else FAILED


def print_topics(rows: list[TrialRow]) -> None:
    """A line for each kind, a column for each stream: tried / answered / same."""
    told = {(row.kind, row.stream): row for row in rows}
    streams = [stream for stream in ALL_STREAMS if any(row.stream == stream for row in rows)]
    print(f"| {' | '.join(['', *streams])} |")
    print("|---" * (len(streams) + 1) + "|")
    for kind in dict.fromkeys(row.kind for row in rows):
        cells = [
            f"{row.tried} / {row.answered} / {row.same}" if (row := told.get((kind, s))) else ""
            for s in streams
        ]
        print(f"| {' | '.join([kind, *cells])} |")
    sums = [sum(getattr(row, name) for row in rows) for name in ("tried", "answered", "same")]
    holding = sum(row.holds for row in rows)
    print(f"\n{' / '.join(map(str, sums))} in all; {holding} of {len(rows)} faults hold")


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    outages_parser = commands.add_parser("outages", help="features or twists missing for a while")
    outages_parser.set_defaults(run=run_outages)
    add = outages_parser.add_argument
    add("data", type=Path, metavar="DATA_OR_BAG")
    add("--reference", type=Path, required=True, metavar="REF.tum")
    add("--seconds", type=float, nargs="+", default=[1.0, 2.0, 5.0], help="of each hole (1 2 5)")
    add("--places", type=int, default=10, help="where holes begin, spread over the drive (10)")
    topics_parser = commands.add_parser("topics", help="one faulty message, on live topics")
    topics_parser.set_defaults(run=run_topics)
    add = topics_parser.add_argument
    add("--streams", nargs="+", choices=ALL_STREAMS, default=ALL_STREAMS, help="(all)")
    add("--kinds", nargs="+", metavar="KIND", help="as in the table (all)")
    for name, command in (("outages", outages_parser), ("topics", topics_parser)):
        out = RESULTS / f"{name}.json"
        command.add_argument("--out", type=Path, default=out, metavar="FILE", help=f"({out})")
        command.add_argument("--force", action="store_true", help="replace FILE")
    arguments = parser.parse_args()
    try:
        return int(arguments.run(arguments))
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
