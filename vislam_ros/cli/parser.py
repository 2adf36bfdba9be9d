# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line's grammar: every command and flag of ``vislam``, in one place."""

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

from vislam_ros import __version__
from vislam_ros.core.filters.registry import estimator_names
from vislam_ros.nodes.player.options import PlayOptions

_PLAY = PlayOptions()
# As in vislam_ros.data.datasets.conventions, which takes longer to import than --help should.
_IMU_FRAMES = ("auto", "flu", "frd", "as-given")
_TWIST_INDICES = ("auto", "end", "start")
_TWIST_ORIGINS = ("auto", "body", "imu")

_RETURNS = """\
exit code: 0 on success, 1 on an error (one line on stderr; -v shows where it came from), 2 on
wrong usage, 130 after Ctrl-C"""


def build_parser() -> argparse.ArgumentParser:
    """Make the parser; the parsed ``command`` names the module that runs it."""
    parser = argparse.ArgumentParser(
        prog="vislam",
        description="EKF visual-inertial SLAM from stereo feature tracks and IMU twist.",
        epilog=f"""\
a first run:
  vislam simulate drive.npz
  vislam run drive.npz --out results
  vislam evaluate results --reference drive.tum

{_RETURNS}""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.set_defaults(verbose=False)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in (
        _add_simulate,
        _add_convert,
        _add_play,
        _add_run,
        _add_solve,
        _add_evaluate,
        _add_plot,
        _add_verify,
        _add_sweep,
    ):
        add(commands)
    return parser


_Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def _command(
    commands: _Commands, name: str, description: str, examples: str
) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name,
        help=description,
        description=f"{description[0].upper()}{description[1:]}.",
        epilog=f"examples:\n{examples}\n{_RETURNS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="show where an error is from")
    return parser


def _add_simulate(commands: _Commands) -> None:
    parser = _command(
        commands,
        "simulate",
        "write a simulated drive with exact ground truth beside it",
        """\
  vislam simulate drive.npz
  vislam simulate hard.npz --steps 500 --outliers 0.05 --frozen 0.1 --gyro-bias -0.01 -0.01 -0.01
  vislam simulate again.npz --along reference.tum --landmarks 4000
""",
    )
    parser.add_argument("output", metavar="OUT.npz", type=Path, help="OUT.tum is written, too")
    parser.add_argument(
        "--along",
        type=Path,
        metavar="REF.tum",
        help="drive along these poses of a body (x forward), at their times, to their end",
    )
    # What is not given is left to the simulation's own defaults, which the texts repeat.
    for flag, name, kind, metavar, text in (
        ("--steps", "steps", _whole(2), "N", "feature frames, ten a second (600)"),
        ("--landmarks", "landmarks", _whole(1), "N", "tracks in the whole drive (3000)"),
        ("--pixel-noise", "pixel_noise_std", _number(0), "PX", "white noise (1)"),
        (
            "--disparity-offset",
            "disparity_offset_std",
            _number(0),
            "PX",
            "error of a disparity that stays for the life of its track (0)",
        ),
        ("--velocity-noise", "velocity_noise_std", _number(0), "M/S", "of a sample (0.1)"),
        (
            "--angular-velocity-noise",
            "angular_velocity_noise_std",
            _number(0),
            "RAD/S",
            "of a sample (0.01)",
        ),
        ("--outliers", "outlier_share", _number(0, 1), "SHARE", "of sliding tracks (0.03)"),
        (
            "--frozen",
            "frozen_share",
            _number(0, 0.5),
            "SHARE",
            "of steps at which old tracks repeat their pixels (0)",
        ),
        ("--seed", "seed", _whole(0), "N", "of everything random (0)"),
    ):
        parser.add_argument(flag, dest=name, type=kind, metavar=metavar, help=text)
    parser.add_argument(
        "--gyro-bias",
        type=_number(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="constant error of the angular velocity, rad/s (0.002 0.002 0.002)",
    )
    _add_force(parser)


def _add_convert(commands: _Commands) -> None:
    parser = _command(
        commands,
        "convert",
        "write a dataset as an MCAP bag",
        """\
  vislam convert drive.npz drive_bag
  vislam convert 03.npz 03_bag --imu-frame flu --reference 03.tum --force
""",
    )
    parser.add_argument("data", metavar="DATA", type=Path, help=".npz or .npy dataset")
    parser.add_argument("output", metavar="OUT", type=Path, help="bag directory to make")
    _add_reading(parser)
    parser.add_argument(
        "--reference", type=Path, metavar="REF.tum", help="becomes ground_truth/odometry"
    )
    _add_force(parser)


def _add_play(commands: _Commands) -> None:
    parser = _command(
        commands,
        "play",
        "play a bag into ROS topics",
        """\
  vislam play drive_bag
  vislam play drive_bag --rate 0                  as fast as the graph takes it
  vislam play drive_bag --start-offset 10 --duration 20 --start-paused
  vislam play drive_bag --remap /imu/twist:=/car/twist --clock 100

keys on a terminal: space pauses and resumes, the right arrow plays up to the next features
services: player/pause, player/resume, player/step (std_srvs/Trigger)
""",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag directory or .mcap file")
    _add_rate(parser)
    parser.add_argument(
        "--start-offset",
        type=_number(0),
        default=_PLAY.start_offset,
        metavar="S",
        help="begin so many seconds into the bag; latched topics are sent all the same",
    )
    parser.add_argument(
        "--duration", type=_number(0), default=_PLAY.duration, metavar="S", help="play only that"
    )
    parser.add_argument(
        "--loop",
        type=_whole(1),
        nargs="?",
        const=0,
        default=_PLAY.passes,
        metavar="N",
        dest="passes",
        help="play N times, or without N until Ctrl-C; stamps go back each time",
    )
    parser.add_argument(
        "--delay",
        type=_number(0),
        default=_PLAY.delay,
        metavar="S",
        help="wait before the first message, once the subscribers are there",
    )
    parser.add_argument("--start-paused", action="store_true")
    parser.add_argument(
        "--topics", nargs="+", default=_PLAY.topics, metavar="T", help="play these topics only"
    )
    parser.add_argument(
        "--remap", nargs="+", type=_remapping, default=_PLAY.remap, metavar="FROM:=TO"
    )
    parser.add_argument(
        "--clock",
        type=_number(0.1),
        nargs="?",
        const=40.0,
        default=_PLAY.clock_rate,
        metavar="HZ",
        dest="clock_rate",
        help="publish /clock (40 Hz without a number)",
    )
    parser.add_argument(
        "--wait",
        type=_number(0),
        default=_PLAY.wait,
        metavar="S",
        help=f"wait so long for the subscribers of features and twist ({_PLAY.wait:g})",
    )
    parser.add_argument(
        "--subscribers",
        type=_whole(1),
        default=_PLAY.subscribers,
        metavar="N",
        help=f"how many subscribers each of the two needs ({_PLAY.subscribers})",
    )
    parser.add_argument(
        "--whole-graph",
        action="store_true",
        help="wait until the three nodes hear each other, too",
    )
    parser.add_argument(
        "--window",
        type=_whole(1),
        default=_PLAY.window,
        metavar="N",
        help=f"at rate 0, feature frames ahead of slam/odometry ({_PLAY.window})",
    )


def _add_run(commands: _Commands) -> None:
    parser = _command(
        commands,
        "run",
        "run the whole live graph over a drive: three nodes and the player",
        """\
  vislam run drive.npz --out results              in real time, as on a car
  vislam run drive.npz --out results --rate 0     as fast as the graph takes it
  vislam run drive_bag --out results --params config/ekf.yaml --force
  vislam run drive.npz --out results --estimator localization --map before/landmarks.npz
""",
    )
    _add_estimation(parser)
    _add_rate(parser)


def _add_solve(commands: _Commands) -> None:
    parser = _command(
        commands,
        "solve",
        "estimate offline, in one process, to the same last bit as the live graph",
        """\
  vislam solve drive.npz --out results
  vislam solve drive.npz --out results --smooth
  vislam solve drive_bag --out third --fraction 0.33 --seed 1
""",
    )
    _add_estimation(parser)
    _add_smooth(parser)


def _add_evaluate(commands: _Commands) -> None:
    parser = _command(
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


def _add_plot(commands: _Commands) -> None:
    parser = _command(
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
    _add_force(parser)


def _add_verify(commands: _Commands) -> None:
    _command(
        commands,
        "verify",
        "tell whether a bag or a result directory is whole",
        """\
  vislam verify drive_bag
  vislam verify results
""",
    ).add_argument("path", metavar="BAG_OR_DIR", type=Path)


def _add_sweep(commands: _Commands) -> None:
    parser = _command(
        commands,
        "sweep",
        "solve a drive, or simulated ones, with every setting of a grid",
        """\
  vislam sweep drive.npz --out sweep --reference truth.tum \\
      --set slam_node.chi2_gate=9,16.27,25 --set slam_node.feature_fraction=0.33,0.5 --seeds 5
  vislam sweep --simulate --seeds 20 --out monte_carlo --set simulate.frozen_share=0,0.1
  vislam sweep --file sweep.yaml --out sweep --dask tcp://host:8786

The same command again does what is missing. A file holds data, reference, params, grid, seeds
and simulate, as below; its paths are relative to it, and flags go over it.
  grid: {slam_node.chi2_gate: [9, 16.27], slam_node.pixel_variance: [[1, 1, 1, 1], [9, 9, 9, 9]]}
  seeds: 5
  simulate: {steps: 300, frozen_share: 0.1}
""",
    )
    drive = parser.add_mutually_exclusive_group()
    drive.add_argument("data", metavar="DATA", type=Path, nargs="?", help="dataset or bag")
    drive.add_argument(
        "--simulate", action="store_true", help="simulate a drive for each seed instead"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="of the sweep")
    parser.add_argument("--file", type=Path, metavar="SWEEP.yaml", help="describes the sweep")
    parser.add_argument(
        "--set",
        type=_assignment,
        action="append",
        default=[],
        metavar="NODE.NAME=V,...",
        help="values of a parameter, or of a simulate.NAME; one value is set and not swept",
    )
    parser.add_argument(
        "--seeds",
        type=_whole(1),
        metavar="N",
        help="runs at each point: of the simulation, or of the choice of tracks (1)",
    )
    parser.add_argument("--reference", type=Path, metavar="REF.tum", help="the truth")
    parser.add_argument("--params", type=Path, metavar="FILE", help="what is not swept")
    parser.add_argument("--map", type=Path, metavar="FILE", help="for estimator localization")
    parser.add_argument("--jobs", type=_whole(1), metavar="N", help="processes (all cores)")
    parser.add_argument("--dask", metavar="ADDRESS", help="run on this Dask cluster")
    _add_smooth(parser)
    _add_reading(parser)
    parser.add_argument("--force", action="store_true", help="begin anew, forgetting old runs")
    # What a run takes besides; here they are settings like others.
    parser.set_defaults(estimator=None, fraction=None, seed=None)


def _add_estimation(parser: argparse.ArgumentParser) -> None:
    """Add what run and solve share."""
    parser.add_argument("data", metavar="DATA_OR_BAG", type=Path, help="dataset or bag")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="result directory")
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="ROS parameter file (config/ekf.yaml)"
    )
    names = estimator_names()
    parser.add_argument(
        "--estimator",
        type=_one_of(names, ":", "module:Class"),
        metavar="NAME",
        help=f"{', '.join(names)}, or module:Class of your own",
    )
    parser.add_argument(
        "--fraction", type=_number(0, 1), metavar="F", help="share of the tracks to use"
    )
    parser.add_argument("--seed", type=_whole(0), metavar="N", help="of the choice of tracks")
    parser.add_argument(
        "--map", type=Path, metavar="FILE", help="landmarks.npz for --estimator localization"
    )
    _add_reading(parser)
    _add_force(parser)


def _add_smooth(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="go back over the drive, for smoothed poses and the exact map "
        "(robocentric and joint)",
    )


def _add_reading(parser: argparse.ArgumentParser) -> None:
    """Add how a dataset is read."""
    parser.add_argument(
        "--imu-frame",
        choices=_IMU_FRAMES,
        default="auto",
        help="axes of the dataset's twists, which its extrinsics are turned to; auto finds what "
        "fits the images",
    )
    parser.add_argument(
        "--twist-index",
        choices=_TWIST_INDICES,
        default="auto",
        help="whether a step has the twist of its start or its end; auto finds what fits",
    )
    parser.add_argument(
        "--twist-origin",
        choices=_TWIST_ORIGINS,
        default="auto",
        help="whether the twists are the body's or those of an IMU that the extrinsics misplace; "
        "auto looks at turns",
    )


def _add_rate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--rate",
        type=_number(0),
        default=_PLAY.rate,
        metavar="R",
        help=f"times real time; 0: as fast as the graph takes it, losing nothing ({_PLAY.rate:g})",
    )


def _add_force(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--force", action="store_true", help="replace an output that exists")


def _number(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """Argument type of a finite number in a range, limits included."""

    def number(text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text} is not {_range_text(low, high)}")
        return value

    return number


def _whole(low: int) -> Callable[[str], int]:
    """Argument type of a whole number from ``low`` on."""

    def whole_number(text: str) -> int:
        value = int(text)
        if value < low:
            raise argparse.ArgumentTypeError(f"{text} is not {_range_text(low, math.inf)}")
        return value

    return whole_number


def _range_text(low: float, high: float) -> str:
    if high < math.inf:
        return f"from {low:g} to {high:g}"
    return "a finite number" if low == -math.inf else f"a finite number from {low:g} on"


def _one_of(names: Sequence[str], mark: str, other: str) -> Callable[[str], str]:
    """Argument type of one of some names, or of another kind of text that has a mark in it."""

    def name(text: str) -> str:
        if text not in names and mark not in text:
            raise argparse.ArgumentTypeError(
                f"{text!r} is none of {', '.join(names)}, nor {other}"
            )
        return text

    return name


def _assignment(text: str) -> tuple[str, str]:
    """Argument type of a setting's name and its values."""
    name, _, values = text.partition("=")
    if not (name and values):
        raise argparse.ArgumentTypeError(f"{text} is not NODE.NAME=VALUE,...")
    return name, values


def _remapping(text: str) -> str:
    """Argument type of a ROS remapping rule."""
    source, _, target = text.partition(":=")
    if not (source and target):
        raise argparse.ArgumentTypeError(f"{text} is not FROM:=TO")
    return text
