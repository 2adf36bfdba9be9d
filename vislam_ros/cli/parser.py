# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line's grammar: every command of ``vislam``, in the order of its help."""

import argparse

from vislam_ros import __version__
from vislam_ros.cli.grammar.data import add_convert, add_inspect, add_simulate, add_track
from vislam_ros.cli.grammar.estimation import add_run, add_solve, add_sweep
from vislam_ros.cli.grammar.playing import add_play
from vislam_ros.cli.grammar.results import (
    add_evaluate,
    add_export,
    add_plot,
    add_report,
    add_verify,
    add_view,
)
from vislam_ros.cli.grammar.shared import RETURNS
from vislam_ros.cli.grammar.suggestions import SuggestingParser


def build_parser() -> argparse.ArgumentParser:
    """Make the parser; the parsed ``command`` names the module that runs it."""
    parser: argparse.ArgumentParser = SuggestingParser(
        prog="vislam",
        usage="vislam COMMAND ...",
        description="""\
EKF visual-inertial SLAM from stereo feature tracks and IMU twist.

to begin with:
  vislam simulate drive.npz                         a drive, and the truth in drive.tum
  vislam run drive.npz --out results                live through the nodes, with pictures
  vislam evaluate results --reference drive.tum     how far from the truth

vislam COMMAND --help has examples of each.""",
        epilog=f"""\
tab completion: eval "$(register-python-argcomplete vislam)"

{RETURNS}""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.set_defaults(verbose=False)
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", title="commands", required=True, prog="vislam"
    )
    for add in (
        add_simulate,
        add_inspect,
        add_track,
        add_convert,
        add_play,
        add_run,
        add_solve,
        add_evaluate,
        add_plot,
        add_report,
        add_view,
        add_export,
        add_verify,
        add_sweep,
    ):
        add(commands)
    return parser
