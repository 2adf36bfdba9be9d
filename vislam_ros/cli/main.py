# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The umbrella command ``vislam``, and the one place where its errors become a line."""

import argparse
import importlib
import os
import sys
import traceback
import warnings
from collections.abc import Sequence

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK, PIPE_CLOSED
from vislam_ros.cli.interrupts import is_interrupt, take_interrupts
from vislam_ros.cli.lines import tell
from vislam_ros.errors import reason_of
from vislam_ros.importing import importing


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; wrong usage raises SystemExit(2).

    Without a command it prints the help.
    """
    verbose = False
    try:
        take_interrupts()
        # Imported here, so that an interrupt meanwhile ends as any other.
        with importing():
            from vislam_ros.cli.parser import build_parser

        parser = build_parser()
        _answer_shell(parser)
        if not (sys.argv[1:] if argv is None else argv):
            parser.print_help()
            return OK
        arguments = parser.parse_args(argv)
        verbose = arguments.verbose
        with warnings.catch_warnings():
            if not (verbose or sys.warnoptions):
                # They name lines of sources, and tell a user nothing that an error would not.
                warnings.simplefilter("ignore")
            # Only the command that runs is imported: some bring ROS or matplotlib.
            with importing():
                from vislam_ros.cli.grammar.paths import check_paths

                check_paths(arguments)
                module = importlib.import_module(f"vislam_ros.cli.commands.{arguments.command}")
            code = int(module.run(arguments))
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except SystemExit:
        _leave_stdout()
        raise
    except BrokenPipeError:
        # Whoever read has heard enough, as `head` has.
        _leave_stdout()
        return PIPE_CLOSED
    except BaseException as error:
        if is_interrupt(error):
            tell("interrupted")
            return INTERRUPTED
        if verbose:
            traceback.print_exc()
        _leave_stdout()
        tell(f"error: {reason_of(error)}")
        return FAILED


def prepare(words: Sequence[str]) -> None:
    """Import what a command is going to need, of which the first words are known."""
    importlib.import_module("vislam_ros.cli.parser")
    importlib.import_module(f"vislam_ros.cli.commands.{words[0]}")


def _answer_shell(parser: argparse.ArgumentParser) -> None:
    """Where a shell asks for tab completion, tell it what may follow, and end."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)


def _leave_stdout() -> None:
    """Write out what is printed, or drop it where it cannot be, so that the end says no more."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
