# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands that look at results: evaluate, plot, verify."""

from pathlib import Path

from vislam_ros.cli.grammar.shared import Commands, add_command, add_force


def add_evaluate(commands: Commands) -> None:
    """Add the command that compares with a reference."""
    parser = add_command(
        commands,
        "evaluate",
        "compare results with a reference: ATE, RPE, NEES",
        """\
  vislam evaluate results --reference drive.tum
  vislam evaluate results --reference drive.tum --json > errors.json
""",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="of a run or solve")
    parser.add_argument("--reference", type=Path, required=True, metavar="REF.tum")
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")


def add_plot(commands: Commands) -> None:
    """Add the command that draws."""
    parser = add_command(
        commands,
        "plot",
        "draw pictures of results",
        """\
  vislam plot results
  vislam plot results --reference drive.tum --output pictures
""",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="of a run or solve")
    parser.add_argument("--reference", type=Path, metavar="REF.tum", help="draw this path, too")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="for the pictures (DIR)")
    add_force(parser)


def add_verify(commands: Commands) -> None:
    """Add the command that tells whether files are whole."""
    parser = add_command(
        commands,
        "verify",
        "tell whether a bag or a result directory is whole, and solve can read it",
        """\
  vislam verify drive_bag
  vislam verify results
""",
    )
    parser.add_argument("path", metavar="BAG_OR_DIR", type=Path)
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="what solve is to read the bag with"
    )
    parser.set_defaults(estimator=None, fraction=None, seed=None, map=None)
