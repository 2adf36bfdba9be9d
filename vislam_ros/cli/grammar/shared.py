# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What several commands share: how each begins and ends, and flags that mean the same in all."""

import argparse
from pathlib import Path
from typing import TypeAlias

from vislam_ros.cli.grammar.argument_types import number_from, remapping
from vislam_ros.nodes.player.options import PlayOptions

PLAY = PlayOptions()
# So much faster than real time the clock of a player stays within ROS's; 0 has no limit.
_FASTEST = 1e6
# As in vislam_ros.data.simulation.images, and vislam_ros.data.datasets.conventions, which take
# longer to import than --help should.
SCENES = ("street", "room")
IMU_FRAMES = ("auto", "flu", "frd", "as-given")
TWIST_INDICES = ("auto", "end", "start")
TWIST_ORIGINS = ("auto", "body", "imu")
EXTRINSICS = ("auto", "imu-to-optical", "flu-to-imu", "optical-to-imu", "imu-to-flu")
# Likewise of vislam_ros.data.evaluation and of vislam_ros.data.trajectory_files.
ALIGNMENTS = ("se3", "yaw", "none")
MAX_DIFFERENCE = 0.01
LAYINGS = (*ALIGNMENTS, "first")
FILE_FORMATS = ("tum", "euroc", "kitti")
PICTURE_FORMATS = ("png", "svg")

#: Flags that are put over a parameter file, for a command that has none of them.
NO_OVERRIDES = {
    "estimator": None,
    "fraction": None,
    "seed": None,
    "map": None,
    "motion_source": None,
}

RETURNS = """\
exit code: 0 on success, 1 on an error (one line on stderr; -v shows where it came from), 2 on
wrong usage, 130 after Ctrl-C, 141 where whoever reads the output has left"""

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_command(
    commands: Commands, name: str, description: str, examples: str
) -> argparse.ArgumentParser:
    """Add a command; its description is its help, too."""
    parser = commands.add_parser(
        name,
        help=description,
        description=f"{description[0].upper()}{description[1:]}.",
        epilog=f"examples:\n{examples}\n{RETURNS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="show where an error is from")
    return parser


def add_smooth(parser: argparse.ArgumentParser) -> None:
    """Add whether to go back over the drive."""
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="go back over the drive, for smoothed poses and the exact map "
        "(robocentric, joint, and those of your own that can)",
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add how a dataset is read."""
    parser.add_argument(
        "--format",
        metavar="MODULE",
        help="of your own, a file of matches(path) and read(path) in the current folder or on the "
        "path of Python (docs/python.md)",
    )
    parser.add_argument(
        "--imu-frame",
        choices=IMU_FRAMES,
        default="auto",
        help="axes of the dataset's twists, which its extrinsics are turned to; auto finds what "
        "fits the images",
    )
    parser.add_argument(
        "--twist-index",
        choices=TWIST_INDICES,
        default="auto",
        help="whether a step has the twist of its start or its end; auto finds what fits",
    )
    parser.add_argument(
        "--twist-origin",
        choices=TWIST_ORIGINS,
        default="auto",
        help="whether the twists are the body's or those of an IMU that the extrinsics misplace; "
        "auto looks at turns",
    )
    parser.add_argument(
        "--extrinsics",
        choices=EXTRINSICS,
        default="auto",
        help="what extL_T_imu and extR_T_imu map to what (flu: a camera with x forward, y left, z "
        "up); auto takes what makes a stereo pair and fits the images",
    )


def add_motion(parser: argparse.ArgumentParser) -> None:
    """Add where the motion of images comes from."""
    parser.add_argument(
        "--motion",
        type=Path,
        metavar="DATA",
        help="for images: dataset or bag with the motion, the times and the extrinsics, in place "
        "of those that the images have",
    )


def add_tracks(parser: argparse.ArgumentParser, text: str) -> None:
    """Add whether images are tracked before they go on."""
    parser.add_argument("--tracks", action="store_true", help=text)


def add_remap(parser: argparse.ArgumentParser) -> None:
    """Add what a bag calls its topics."""
    parser.add_argument(
        "--remap",
        nargs="+",
        type=remapping,
        default=PLAY.remap,
        metavar="OURS:=NAME",
        help="what the bag calls a topic, as in imu/twist:=/car/twist",
    )


def add_rate(parser: argparse.ArgumentParser) -> None:
    """Add how fast to play."""
    parser.add_argument(
        "--rate",
        type=number_from(0, _FASTEST),
        default=PLAY.rate,
        metavar="R",
        help=f"times real time; 0: as fast as the graph takes it, losing nothing ({PLAY.rate:g})",
    )


def add_namespace(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the namespace of one robot among others."""
    parser.add_argument("--namespace", default=PLAY.namespace, metavar="NS", help=text)


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add whether to replace an output."""
    parser.add_argument("--force", action="store_true", help="replace an output that exists")
