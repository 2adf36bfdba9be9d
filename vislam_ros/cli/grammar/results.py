# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands that look at results: evaluate, export, plot, verify."""

from pathlib import Path

from vislam_ros.cli.grammar.argument_types import number_from
from vislam_ros.cli.grammar.shared import (
    ALIGNMENTS,
    FILE_FORMATS,
    LAYINGS,
    MAX_DIFFERENCE,
    NO_OVERRIDES,
    PICTURE_FORMATS,
    Commands,
    add_command,
    add_force,
    add_motion,
    add_namespace,
    add_reading,
    add_remap,
)


def add_evaluate(commands: Commands) -> None:
    """Add the command that compares with a reference."""
    parser = add_command(
        commands,
        "evaluate",
        "compare results with a reference: ATE, RPE, NEES",
        """\
  vislam evaluate results --reference drive.tum
  vislam evaluate results/live results/offline other_program.tum --reference data.csv
  vislam evaluate results --reference drive.tum --align yaw --max-difference 0.05
  vislam evaluate results --reference drive.tum --json > errors.json

A row for each estimate: filtered, smoothed where there is such, and dead reckoning. ATE and RPE
are those of evo_ape tum --align and evo_rpe tum; stretches of 50 to 400 m are KITTI's. Of several
runs --json prints a list.
""",
    )
    parser.add_argument(
        "runs",
        metavar="DIR",
        type=Path,
        nargs="+",
        help="of a run or solve; or a trajectory of another program, as the reference",
    )
    parser.add_argument(
        "--reference",
        type=Path,
        required=True,
        metavar="REF",
        help="TUM file, in seconds or nanoseconds, or EuRoC's csv",
    )
    parser.add_argument(
        "--align",
        choices=ALIGNMENTS,
        default="se3",
        help="what may be turned and shifted before the ATE: all (se3), yaw and position, nothing",
    )
    parser.add_argument(
        "--max-difference",
        type=number_from(0),
        default=MAX_DIFFERENCE,
        metavar="S",
        help=f"poses farther apart in time are not compared ({MAX_DIFFERENCE:g})",
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of the tables")


def add_export(commands: Commands) -> None:
    """Add the command that writes a trajectory for other programs."""
    parser = add_command(
        commands,
        "export",
        "write the trajectory of results for other programs: TUM, EuRoC, KITTI",
        """\
  vislam export results data.csv --format euroc
  vislam export results 03.txt --format kitti --camera-of 03.npz
  vislam export results smoothed.tum --format tum --estimate smoothed
  vislam export data.csv reference.tum --format tum

KITTI's poses have no times: these stand in NAME_times.txt beside NAME.txt. They are the left
camera's with --camera-of, the body's without.
""",
    )
    parser.add_argument(
        "results",
        metavar="DIR",
        type=Path,
        help="of a run or solve; or a TUM file or EuRoC's csv to convert",
    )
    parser.add_argument("output", metavar="OUT", type=Path, help="file to make")
    parser.add_argument("--format", choices=FILE_FORMATS, required=True, help="of the file")
    parser.add_argument(
        "--estimate",
        choices=("filtered", "smoothed", "dead-reckoning"),
        default="filtered",
        help="which trajectory of the results",
    )
    parser.add_argument(
        "--camera-of",
        type=Path,
        metavar="DATA_OR_BAG",
        help="write the poses of this drive's left camera, from where it was first",
    )
    add_force(parser)


def add_plot(commands: Commands) -> None:
    """Add the command that draws."""
    parser = add_command(
        commands,
        "plot",
        "draw pictures of results: path and heights, steps, estimates, errors",
        """\
  vislam plot results
  vislam plot results --reference drive.tum --output pictures
  vislam plot results --reference drive.tum --align first     how it drifts from the start
  vislam plot results --format svg --output for_the_paper

The errors beside the names of the paths are those of what is drawn: with --align se3 the ATE of
`vislam evaluate`, with first the distances of paths that begin in the same pose.
""",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="of a run or solve")
    parser.add_argument("--reference", type=Path, metavar="REF.tum", help="draw this path, too")
    parser.add_argument(
        "--align",
        choices=LAYINGS,
        default="se3",
        help="how each path is laid onto the reference: best fit (se3, yaw), first pose, not",
    )
    parser.add_argument("--format", choices=PICTURE_FORMATS, default="png", help="of the pictures")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="for the pictures (DIR)")
    add_force(parser)


def add_report(commands: Commands) -> None:
    """Add the command that writes a page."""
    parser = add_command(
        commands,
        "report",
        "write results as one HTML page with an interactive map, which opens offline",
        """\
  vislam report results                           results/report.html
  vislam report results --reference drive.tum --output drive.html
  vislam inspect drive.npz --json > results/findings.json; vislam report results --force

It needs plotly: pip install 'vislam_ros[report]'. The page holds it and asks the network for
nothing.
""",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="of a run or solve")
    parser.add_argument("--reference", type=Path, metavar="REF", help="the truth, with errors")
    parser.add_argument(
        "--findings",
        type=Path,
        metavar="FILE",
        help="what `vislam inspect --json` found in the data (DIR/findings.json)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE.html", help="the page (DIR/report.html)"
    )
    add_force(parser)


def add_view(commands: Commands) -> None:
    """Add the command that opens a viewer."""
    parser = add_command(
        commands,
        "view",
        "show results in the Rerun viewer: path, map, covariance, charts, images with tracks",
        """\
  vislam view results
  vislam view results --reference drive.tum --data drive.npz      with the tracks
  vislam view results --data V1_01_easy                           with images and tracks
  vislam view results --save results.rrd                          for `rerun results.rrd` elsewhere

It needs the viewer: pip install 'vislam_ros[view]'. Its program sends its makers anonymous usage
data from the second start on, unless told `rerun analytics disable`.
""",
    )
    parser.add_argument("directory", metavar="DIR", type=Path, help="of a run or solve")
    parser.add_argument("--reference", type=Path, metavar="REF", help="the truth, with errors")
    parser.add_argument(
        "--data",
        type=Path,
        metavar="DATA",
        help="what was solved, for its tracks; images are tracked again",
    )
    add_motion(parser)
    add_reading(parser)
    add_namespace(parser, "namespace of the topics in a bag, as for solve")
    add_remap(parser)
    parser.add_argument(
        "--save", type=Path, metavar="FILE.rrd", help="write this; no screen needed"
    )
    add_force(parser)
    parser.set_defaults(params=None, **NO_OVERRIDES)


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
    parser.add_argument(
        "path", metavar="BAG_OR_DIR", type=Path, help="a bag, or the DIR of a run or solve"
    )
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="what solve is to read the bag with"
    )
    parser.set_defaults(**NO_OVERRIDES)
