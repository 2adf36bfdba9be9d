# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam play``: the player in this process."""

import argparse
import dataclasses
import signal
import sys
from types import FrameType

from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import try_shutdown

from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.interrupts import INTERRUPTS
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.errors import VislamError
from vislam_ros.nodes.player.keys import RIGHT_ARROW, SPACE, watch_keys
from vislam_ros.nodes.player.options import PlayOptions, PlayReport
from vislam_ros.nodes.player.player import Player
from vislam_ros.nodes.spin import init_ros, ros_reason


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    names = [field.name for field in dataclasses.fields(PlayOptions)]
    options = PlayOptions(**{name: getattr(arguments, name) for name in names})
    require_intact(arguments.bag)
    with BagMessages(arguments.bag) as bag:
        # The handlers below are ours: rclpy's would end ROS before the player said good-bye.
        init_ros(["vislam", "--ros-args", *arguments.ros_args])
        try:
            try:
                player = Player(bag, options)
            except (ParameterException, rclpy_implementation.RCLError) as error:
                raise VislamError(ros_reason(error)) from error
            try:
                report = _play(player, bag, options)
            finally:
                player.destroy_node()
        finally:
            try_shutdown()
    _print(report)
    return OK if report.state == "finished" else INTERRUPTED


def _play(player: Player, bag: BagMessages, options: PlayOptions) -> PlayReport:
    def interrupt(_signal: int, _frame: FrameType | None) -> None:
        player.clock.interrupt()

    before = {number: signal.signal(number, interrupt) for number in INTERRUPTS}
    seconds = min(options.duration, bag.duration * 1e-9 - options.start_offset)
    keys = {SPACE: player.toggle, RIGHT_ARROW: player.step}
    try:
        with progress_bar("playing", seconds) as update, watch_keys(keys):
            return player.play(
                lambda done: update(done, f"{player.state} {player.report.rate:.2f} x")
            )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print(report: PlayReport) -> None:
    print(
        f"{report.state}: {report.messages} messages, {report.bag_seconds:.2f} s in "
        f"{report.wall_seconds:.2f} s ({report.rate:.2f} times real time), {_delivery(report)}",
        file=sys.stderr,
    )


def _delivery(report: PlayReport) -> str:
    """What became of the messages."""
    untaken = sum(report.untaken.values())
    if untaken and untaken == report.messages:
        return "and nobody listened"
    if not report.delivered:
        return "NOT all delivered"
    if not untaken:
        return "all delivered"
    topics = ", ".join(sorted(report.untaken))
    return f"{report.messages - untaken} delivered and {untaken} taken by nobody ({topics})"
