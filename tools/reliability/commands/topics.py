# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One faulty message on a topic of the running nodes: what it costs.

tools/faults.py topics
tools/faults.py topics --streams twist features --out results/topics.json
"""

import argparse
import sys
from pathlib import Path

from reliability.output import add_output, write_output
from reliability.topic_faults import STREAMS, all_faults
from reliability.topic_trials import TrialRow, measure_topic_faults
from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.data.files.whole_file import refuse_existing

_ALL_STREAMS = (*STREAMS, "calibration")
_OUT = Path("results") / "topics.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("--streams", nargs="+", choices=_ALL_STREAMS, default=_ALL_STREAMS, help="(all)")
    add("--kinds", nargs="+", metavar="KIND", help="as in the table (all)")
    add_output(parser, _OUT)


def run_command(arguments: argparse.Namespace) -> int:
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
    write_output(arguments.out, [row.as_dict() for row in rows])
    print_table(rows)
    return OK if all(row.holds for row in rows) else FAILED


def print_table(rows: list[TrialRow]) -> None:
    """A line for each kind, a column for each stream: tried / answered / same."""
    told = {(row.kind, row.stream): row for row in rows}
    streams = [stream for stream in _ALL_STREAMS if any(row.stream == stream for row in rows)]
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
