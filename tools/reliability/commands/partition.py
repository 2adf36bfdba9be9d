# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes in network namespaces, with a discovery server and a link that breaks and heals.

tools/faults.py partition
tools/faults.py partition --members player --seconds 3 --rates 1
"""

import argparse
import sys
import tempfile
from pathlib import Path

from reliability.load.network import network
from reliability.load.offline import offline_trajectory
from reliability.load.partition import (
    MEMBERS,
    PartitionRow,
    measure_partition,
    partitions,
)
from reliability.output import add_output, write_output
from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.files.whole_file import refuse_existing
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

_OUT = Path("results") / "partition.json"
_DRIVE = SimulationSettings(steps=100, landmarks=700)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("--members", nargs="+", choices=MEMBERS, default=list(MEMBERS), help="whose link (all)")
    add("--seconds", nargs="+", type=float, default=[1.0, 3.0, 10.0], help="it is down (1 3 10)")
    add("--rates", nargs="+", type=float, default=[1.0, 0.0], help="of the player (1 0)")
    add(
        "--moments",
        nargs="+",
        type=float,
        default=[0.3, 0.9],
        help="shares of the poses after which it breaks (0.3 0.9)",
    )
    add_output(parser, _OUT)


def run_command(arguments: argparse.Namespace) -> int:
    """Break each link in a run of its own, and print what came of it."""
    refuse_existing(arguments.out, force=arguments.force)
    planned = partitions(arguments.members, arguments.seconds, arguments.rates, arguments.moments)
    rows: list[PartitionRow] = []
    try:
        with (
            tempfile.TemporaryDirectory(prefix="vislam_partition_") as scratch,
            network(MEMBERS) as built,
        ):
            bag = Path(scratch) / "bag"
            write_bag(simulate(_DRIVE).drive, bag)
            offline = offline_trajectory(bag, Path(scratch) / "offline")
            for number, partition in enumerate(planned):
                out = Path(scratch) / f"run_{number}"
                rows.append(measure_partition(built, bag, offline, out, partition))
                print(f"{len(rows)} of {len(planned)}", end="\r", file=sys.stderr)
                if rows[-1].outcome != "whole":
                    print(f"{rows[-1].outcome}: {rows[-1]}", file=sys.stderr)
    finally:  # also after Ctrl-C
        write_output(arguments.out, [row.as_dict() for row in rows])
        print_table(rows)
    return OK if all(row.outcome != "silent" for row in rows) else FAILED


def print_table(rows: list[PartitionRow]) -> None:
    """A line for each link and rate, a column for each length."""
    lengths = sorted({row.partition.seconds for row in rows})
    print(f"| link of | rate | {' | '.join(f'{length:g} s' for length in lengths)} |")
    print("|---" * (len(lengths) + 2) + "|")
    lines = dict.fromkeys((row.partition.member, row.partition.rate) for row in rows)
    for member, rate in lines:
        cells = []
        for length in lengths:
            wanted = (member, rate, length)
            some = [
                row
                for row in rows
                if (row.partition.member, row.partition.rate, row.partition.seconds) == wanted
            ]
            cells.append(", ".join(_cell(row) for row in some))
        print(f"| {member} | {rate:g} | {' | '.join(cells)} |")


def _cell(row: PartitionRow) -> str:
    if row.outcome == "whole":
        return f"{row.poses} same"
    return f"{row.poses} of {row.expected}, {row.outcome}: {row.reason}"
