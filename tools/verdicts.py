#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Count what the verdict says of drives as they are, and of drives that are disturbed.

tools/verdicts.py drive.npz another.npz
tools/verdicts.py drive.npz --only none "velocity x 2" --out results/verdicts.json
"""

import argparse
import sys
from pathlib import Path

from reliability.disturbances import DISTURBANCES
from reliability.output import add_output, write_output
from reliability.verdicts import (
    FRACTIONS,
    PARTS,
    UNDISTURBED,
    VerdictRow,
    measure_verdicts,
    simulated_drives,
    trials,
)

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.data.files.whole_file import refuse_existing
from vislam_ros.data.loading import load_drive
from vislam_ros.errors import VislamError

OUT = Path("results") / "verdicts.json"


def measure(arguments: argparse.Namespace) -> list[VerdictRow]:
    """Rows of all that is asked for, in their order."""
    refuse_existing(arguments.out, force=arguments.force)
    drives = {path.stem: load_drive(path) for path in arguments.data}
    if not arguments.no_simulation:
        drives.update(simulated_drives())
    tasks = trials(list(drives), arguments.only, arguments.parts)
    rows = {}
    for row in measure_verdicts(drives, tasks):
        rows[row.trial] = row
        print(f"{len(rows)} of {len(tasks)}", end="\r", file=sys.stderr)
    write_output(arguments.out, [rows[task].as_dict() for task in tasks])
    return [rows[task] for task in tasks]


def print_tables(rows: list[VerdictRow]) -> None:
    """Print what is said of undisturbed drives, then of each disturbance."""
    kinds = {"recorded": False, "simulated": True}
    print(
        "| undisturbed | tracks | part | good | vision missing | else doubtful | contradiction |"
    )
    print("|---|---|---|---|---|---|---|")
    for kind, simulated in kinds.items():
        for fraction in FRACTIONS:
            for part in PARTS:
                some = [
                    row
                    for row in _of(rows, UNDISTURBED, part, simulated=simulated)
                    if row.trial.fraction == fraction
                ]
                if some:
                    words = ["vision" if row.is_of_vision else row.word for row in some]
                    counts = [
                        str(words.count(word))
                        for word in ("good", "vision", "doubtful", "contradiction")
                    ]
                    print(f"| {kind} | {fraction:.0%} | {part} | {' | '.join(counts)} |")
    print()
    print("| disturbed | recorded: whole | quarters | simulated: whole | quarters | named |")
    print("|---|---|---|---|---|---|")
    for disturbance in DISTURBANCES:
        cells, caught = [], 0
        all_rows: list[VerdictRow] = []
        for simulated in kinds.values():
            for part in PARTS:
                some = _of(rows, disturbance, part, simulated=simulated)
                found = [row for row in some if not row.is_good]
                all_rows += found
                caught += len(some)
                cells.append(f"{len(found)} of {len(some)}" if some else "")
        if caught:
            named = sum(row.is_named for row in all_rows)
            print(f"| {disturbance} | {' | '.join(cells)} | {named} of {len(all_rows)} |")


def _of(
    rows: list[VerdictRow], disturbance: str, part: str, *, simulated: bool
) -> list[VerdictRow]:
    return [
        row
        for row in rows
        if row.trial.disturbance == disturbance
        and row.trial.part == part
        and row.trial.drive.startswith("simulated") == simulated
    ]


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    everything = [UNDISTURBED, *DISTURBANCES]
    add("data", type=Path, nargs="*", metavar="DATA_OR_BAG")
    add("--only", nargs="+", choices=everything, default=everything, metavar="DISTURBANCE")
    add("--parts", nargs="+", choices=PARTS, default=PARTS, help="of each drive (both)")
    add("--no-simulation", action="store_true", help="leave the simulated drives out")
    add_output(parser, OUT)
    try:
        print_tables(measure(parser.parse_args()))
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    return OK


if __name__ == "__main__":
    sys.exit(main())
