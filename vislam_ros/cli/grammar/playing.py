# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command play."""

import argparse
from pathlib import Path

from vislam_ros.cli.grammar.argument_types import number_from, remapping, whole_from
from vislam_ros.cli.grammar.shared import (
    PLAY,
    Commands,
    add_command,
    add_namespace,
    add_rate,
)

# Stamps go no farther than some 290 years [s].
_LONGEST = 9.2e9


def add_play(commands: Commands) -> None:
    """Add the command that plays a bag."""
    parser = add_command(
        commands,
        "play",
        "play a bag into ROS topics",
        """\
  vislam play drive_bag
  vislam play drive_bag --rate 0                  as fast as the graph takes it
  vislam play drive_bag --start-offset 10 --duration 20 --start-paused
  vislam play drive_bag --remap /imu/twist:=/car/twist --clock 100
  vislam play drive_bag --namespace /robot1 --ros-args --log-level warn

keys on a terminal: space pauses and resumes, the right arrow plays up to the next features
services: player/pause, player/resume, player/step (std_srvs/Trigger)
""",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag directory or .mcap file")
    add_rate(parser)
    parser.add_argument(
        "--start-offset",
        type=number_from(0, _LONGEST),
        default=PLAY.start_offset,
        metavar="S",
        help="begin so many seconds into the bag; latched topics are sent all the same",
    )
    parser.add_argument(
        "--duration",
        type=number_from(0),
        default=PLAY.duration,
        metavar="S",
        help="play only that",
    )
    parser.add_argument(
        "--loop",
        type=whole_from(1),
        nargs="?",
        const=0,
        default=PLAY.passes,
        metavar="N",
        dest="passes",
        help="play N times, or without N until Ctrl-C; stamps go back each time",
    )
    parser.add_argument(
        "--delay",
        type=number_from(0),
        default=PLAY.delay,
        metavar="S",
        help="wait before the first message, once the subscribers are there",
    )
    parser.add_argument(
        "--start-paused", action="store_true", help="wait for space or player/resume"
    )
    parser.add_argument(
        "--topics", nargs="+", default=PLAY.topics, metavar="T", help="play these topics only"
    )
    parser.add_argument(
        "--remap",
        nargs="+",
        type=remapping,
        default=PLAY.remap,
        metavar="FROM:=TO",
        help="play a topic of the bag under another name",
    )
    add_namespace(
        parser, "play in this namespace, such as /robot1: all topics of a bag that has none in it"
    )
    parser.add_argument(
        "--clock",
        type=number_from(0.1),
        nargs="?",
        const=40.0,
        default=PLAY.clock_rate,
        metavar="HZ",
        dest="clock_rate",
        help="publish /clock (40 Hz without a number)",
    )
    parser.add_argument(
        "--wait",
        type=number_from(0),
        default=PLAY.wait,
        metavar="S",
        help=f"wait so long for the subscribers of features and twist ({PLAY.wait:g})",
    )
    parser.add_argument(
        "--subscribers",
        type=whole_from(1),
        default=PLAY.subscribers,
        metavar="N",
        help=f"how many subscribers each of the two needs ({PLAY.subscribers})",
    )
    parser.add_argument(
        "--whole-graph",
        action="store_true",
        help="wait until all nodes of the graph hear each other, too",
    )
    parser.add_argument(
        "--window",
        type=whole_from(1),
        default=PLAY.window,
        metavar="N",
        help=f"at rate 0, feature frames ahead of slam/odometry ({PLAY.window})",
    )
    parser.add_argument(
        "--ros-args",
        nargs=argparse.REMAINDER,
        default=[],
        metavar="...",
        help="all that follows is for ROS, as with every node: -r, -p, --params-file, --log-level",
    )
