# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam run``: the live graph as processes, from a drive to a result directory.

This process never touches ROS: it starts the nodes and the player, watches them, and reads what
the recorder writes.
"""

import argparse
import time
from contextlib import closing, suppress
from pathlib import Path

from vislam_ros.cli.processes import prepared_children
from vislam_ros.cli.running.modules import PREPARED
from vislam_ros.cli.running.watch import Watch
from vislam_ros.importing import importing


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    started = time.monotonic()
    # They import for a second, and so does this process.
    with (
        prepared_children(PREPARED if _is_there(arguments.data) else {}) as prepared,
        closing(Watch(prepared.values())) as watch,
    ):
        try:
            with importing():
                from vislam_ros.cli.running.session import run_session

            watch.settle()
        except KeyboardInterrupt:
            watch.check()
            raise
        watch.check()
        return run_session(arguments, started, prepared, watch)


def _is_there(data: Path) -> bool:
    """Whether there may be something to run; what is wrong with it is told later."""
    with suppress(OSError):  # a name that is too long
        return data.exists()
    return False
