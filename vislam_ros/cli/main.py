# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The umbrella command ``vislam``."""

import importlib
import sys
from collections.abc import Sequence

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED
from vislam_ros.cli.interrupts import is_interrupt, take_interrupts
from vislam_ros.errors import VislamError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; wrong usage raises SystemExit(2)."""
    verbose = False
    try:
        take_interrupts()
        # Imported here, so that an interrupt meanwhile ends as any other.
        from vislam_ros.cli.parser import build_parser

        arguments = build_parser().parse_args(argv)
        verbose = arguments.verbose
        # Only the command that runs is imported: some bring ROS or matplotlib.
        module = importlib.import_module(f"vislam_ros.cli.commands.{arguments.command}")
        return int(module.run(arguments))
    except VislamError as error:
        if verbose:
            import traceback

            traceback.print_exc()
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except BaseException as error:
        if not is_interrupt(error):
            raise
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
