# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam run``: the live graph as processes, from a drive to a result directory.

This process never touches ROS: it starts the nodes and the player, watches them, and reads what
the recorder writes.
"""

import argparse
import time

from vislam_ros.cli.processes import prepared_children
from vislam_ros.cli.running.modules import PREPARED
from vislam_ros.importing import importing


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    started = time.monotonic()
    # They import for a second, and so does this process.
    with prepared_children(PREPARED if arguments.data.exists() else {}) as prepared:
        with importing():
            from vislam_ros.cli.running.session import run_session

        return run_session(arguments, started, prepared)
