#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a run's promises when messages, processes or files are not as they should be.

tools/faults.py outages drive.npz --reference truth.tum
tools/faults.py topics
tools/faults.py signals
tools/faults.py files
tools/faults.py load drive.npz
tools/faults.py images folder
tools/faults.py soak drive.npz
tools/faults.py partition
"""

import argparse
import sys

from reliability.commands import (
    files,
    images,
    load,
    outages,
    partition,
    signals,
    soak,
    topics,
)

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED
from vislam_ros.errors import VislamError

COMMANDS = {
    "outages": outages,
    "topics": topics,
    "signals": signals,
    "files": files,
    "load": load,
    "images": images,
    "soak": soak,
    "partition": partition,
}


def main() -> int:
    """Run the command."""
    looks: argparse._FormatterClass = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=looks)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module in COMMANDS.items():
        text = module.__doc__ or ""
        command = commands.add_parser(
            name, help=text.splitlines()[0], description=text, formatter_class=looks
        )
        module.add_arguments(command)
    arguments = parser.parse_args()
    try:
        return COMMANDS[arguments.command].run_command(arguments)
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
