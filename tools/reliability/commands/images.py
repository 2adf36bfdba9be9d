# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a stereo image to its odometry, live, at the images' own rate.

vislam simulate room --images --scene room --rate 20
tools/faults.py images room
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

from benchmark.machine import describe_machine

from reliability.commands.load import print_hops
from reliability.load.images import measure_images
from reliability.output import add_output, write_output
from vislam_ros.cli.exit_codes import OK
from vislam_ros.data.files.whole_file import refuse_existing

_OUT = Path("results") / "images.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("images", type=Path, metavar="IMAGES", help="as `vislam run` takes them")
    add_output(parser, _OUT)


def run_command(arguments: argparse.Namespace) -> int:
    """Measure, and print a table."""
    refuse_existing(arguments.out, force=arguments.force)
    with tempfile.TemporaryDirectory(prefix="vislam_images_") as scratch:
        latency = measure_images(arguments.images, Path(scratch) / "run")
    hop = "left image published → odometry heard"
    print_hops({hop: latency.whole, f"{hop}, after 1 s": latency.settled})
    state = "complete" if latency.complete else "INCOMPLETE"
    print(
        f"\n{latency.heard} left images heard, {latency.answered} odometries, "
        f"{latency.steps} steps, {state}"
    )
    content = {"machine": describe_machine(), **dataclasses.asdict(latency)}
    write_output(arguments.out, content)
    return OK
