# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile files of every kind, each given to a command.

tools/faults.py files
"""

import argparse
import sys
import tempfile
from pathlib import Path

from reliability.hostile_files import cases, shared_cases
from reliability.hostile_runs import Outcome, run, table
from vislam_ros.cli.exit_codes import FAILED, OK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command is told."""
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="WORD", help="cases with such a word in them"
    )
    parser.add_argument(
        "--cases",
        type=Path,
        metavar="DIR",
        help="hostile files that were found before",
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="print what each case says")


def run_command(arguments: argparse.Namespace) -> int:
    """Run all cases, print what is not as it should be, and the table."""
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="vislam_hostile_files_") as folder:
        tried = cases(Path(folder))
        if arguments.cases:
            tried += shared_cases(arguments.cases, Path(folder) / "seed.npz")
        words = [word.lower() for word in arguments.only]
        chosen = [
            each
            for each in tried
            if not words or any(word in f"{each.kind}: {each.name}".lower() for word in words)
        ]
        for case in chosen:
            outcome = run(case)
            outcomes.append(outcome)
            if arguments.verbose or not outcome.is_right:
                print(_description(outcome), file=sys.stderr)
    print("\n".join(table(outcomes)))
    return OK if outcomes and all(outcome.is_right for outcome in outcomes) else FAILED


def _description(outcome: Outcome) -> str:
    what = f"{outcome.case.kind}: {outcome.case.name}"
    cost = f"{outcome.cpu_s:.2f} s of CPU, {outcome.wall_s:.2f} s, {outcome.megabytes:.0f} MB"
    says = " / ".join(outcome.lines[-3:]) or "(nothing)"
    left = f", leaves {', '.join(outcome.left)}" if outcome.left else ""
    mark = "" if outcome.is_right else "NOT RIGHT: "
    return f"{mark}{what}: exit {outcome.code}, {cost}{left}: {says[:400]!r}"
