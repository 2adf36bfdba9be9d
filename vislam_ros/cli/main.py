# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The umbrella command ``vislam``."""

import importlib
import sys
import traceback
from collections.abc import Sequence

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED
from vislam_ros.cli.parser import build_parser
from vislam_ros.errors import VislamError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; wrong usage raises SystemExit(2)."""
    arguments = build_parser().parse_args(argv)
    try:
        # Only the command that runs is imported: some bring ROS or matplotlib.
        module = importlib.import_module(f"vislam_ros.cli.commands.{arguments.command}")
        return int(module.run(arguments))
    except VislamError as error:
        if arguments.verbose:
            traceback.print_exc()
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
