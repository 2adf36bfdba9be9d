#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz all that is read from files, guided by coverage; keeps what it finds and goes on.

tools/fuzz.py --executions 100000
tools/fuzz.py tum yaml --seconds 600 --out results/fuzzing

Needs atheris: pip install 'vislam_ros[fuzz]'. Each target is a process of its own; what it is to
do counts from what DIR has of it already, so a campaign can be gone on with.
"""

import argparse
import contextlib
import importlib
import json
import pkgutil
import subprocess
import sys
import tempfile
from pathlib import Path

from vislam_ros import core
from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.errors import VislamError, reason_of

OUT = Path("results") / "fuzzing"
NAMES = ("npz", "npy", "bag", "mcap", "yaml", "tum", "steps", "summary", "landmarks")


def run_target(name: str, out: Path, scratch: Path, executions: int, seconds: int) -> None:
    """Fuzz one target in this process, which ends with it."""
    import atheris

    # What is compiled cannot be instrumented, so the core is there before.
    for module in pkgutil.walk_packages(core.__path__, f"{core.__name__}."):
        importlib.import_module(module.name)
    with atheris.instrument_imports(include=["vislam_ros", "yaml", "mcap"]):
        from reliability.fuzzing.campaign import Campaign, fuzz
        from reliability.fuzzing.targets import targets
    (target,) = targets(scratch, (name,))
    campaign = Campaign(target, scratch / name, out)
    corpus = out / f"corpus_{name}"
    corpus.mkdir(exist_ok=True)
    fuzz(target, campaign, corpus, executions, seconds)


def print_table(out: Path) -> None:
    """A line for each target, and one for each kind that was found."""
    print("| read | executions | no error | kinds found | slowest, s |")
    print("|---|---|---|---|---|")
    total = 0
    for name in NAMES:
        with contextlib.suppress(FileNotFoundError):
            report = json.loads((out / f"{name}.json").read_bytes())
            total += report["executions"]
            print(
                f"| {name} | {report['executions']} | {report['read']} | {len(report['finds'])} "
                f"| {report['slowest_s']:.2f} |"
            )
            for kind, find in report["finds"].items():
                print(f"|  | {find['count']} | {kind} | {find['file']} | {find['what']} |")
    print(f"| all | {total} | | | |")


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("targets", nargs="*", choices=[*NAMES, []], metavar="TARGET", help=", ".join(NAMES))
    add("--executions", type=int, default=100_000, help="of each target, at most (100000)")
    add("--seconds", type=int, default=600, help="for each target, at most (600)")
    add("--out", type=Path, default=OUT, metavar="DIR", help=f"({OUT})")
    add("--only", choices=NAMES, help=argparse.SUPPRESS)
    add("--scratch", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
        if arguments.only:
            run_target(
                arguments.only,
                arguments.out,
                arguments.scratch,
                arguments.executions,
                arguments.seconds,
            )
            return OK
        for name in arguments.targets or NAMES:
            command = [sys.executable, __file__, "--only", name, "--out", str(arguments.out)]
            limits = [f"--executions={arguments.executions}", f"--seconds={arguments.seconds}"]
            memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
            with (
                tempfile.TemporaryDirectory(prefix="vislam_fuzz_", dir=memory) as scratch,
                (arguments.out / f"{name}.log").open("ab") as log,
            ):
                subprocess.run(
                    [*command, *limits, "--scratch", scratch], stdout=log, stderr=log, check=False
                )
        print_table(arguments.out)
    except (VislamError, OSError, ImportError) as error:
        print(f"error: {reason_of(error)}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    return OK


if __name__ == "__main__":
    sys.exit(main())
