# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive in a loop at full rate for long: memory of the processes, bytes of the passes.

tools/faults.py soak drive.npz
tools/faults.py soak drive.npz --minutes 5 --warm-up 60
"""

import argparse
import sys
import tempfile
from pathlib import Path

from reliability.load.offline import offline_trajectory
from reliability.load.pictures import draw_soak
from reliability.load.soak import Soak, soak
from reliability.output import add_output, write_output
from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.data.conversion import convert
from vislam_ros.data.files.whole_file import refuse_existing, replace_file

_OUT = Path("results") / "soak.json"
_MINUTE = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("data", type=Path, metavar="DATA", help="a drive")
    add("--minutes", type=float, default=30.0, help="(30)")
    add("--warm-up", type=float, default=300.0, metavar="S", help="that does not count (300)")
    add_output(parser, _OUT, "with a .png beside it")


def run_command(arguments: argparse.Namespace) -> int:
    """Loop the drive, and print a line for each process."""
    picture = arguments.out.with_suffix(".png")
    for file in (arguments.out, picture):
        refuse_existing(file, force=arguments.force)
    with tempfile.TemporaryDirectory(prefix="vislam_soak_") as scratch:
        bag = Path(scratch) / "bag"
        convert(arguments.data, bag)
        offline = offline_trajectory(bag, Path(scratch) / "offline")

        def goes_on(seen: Soak) -> bool:
            minutes = seen.seconds[-1] / _MINUTE
            print(f"{minutes:.1f} min, {seen.passes} passes", end="\r", file=sys.stderr)
            return minutes < arguments.minutes

        seen = soak(bag, offline, Path(scratch) / "run", arguments.warm_up, goes_on)
    write_output(arguments.out, seen.as_dict(), indent=None)
    replace_file(picture, draw_soak(seen))
    print_table(seen)
    return OK if seen.holds else FAILED


def print_table(seen: Soak) -> None:
    """A line for each process."""
    print("| process | MB after warm-up | MB at the end | MB in 10 min |")
    print("|---|---|---|---|")
    for name, values in seen.megabytes.items():
        warm = next(v for s, v in zip(seen.seconds, values, strict=True) if s >= seen.warm_up)
        print(f"| {name} | {warm:.1f} | {values[-1]:.1f} | {seen.growth(name):+.2f} |")
    print(f"\n{seen.passes} passes in {seen.seconds[-1] / _MINUTE:.1f} min, {seen.same} the same")
    for what in seen.broken:
        print(what)
