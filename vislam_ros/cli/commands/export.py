# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam export``: a trajectory in the file of another program."""

import argparse
from pathlib import Path

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer
from vislam_ros.data.loading import load_drive
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.trajectory_files import of_camera, read_trajectory, write_trajectory
from vislam_ros.errors import VislamError


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    trajectory = _trajectory(arguments.results, arguments.estimate)
    of_what = "the body"
    if arguments.camera_of is not None:
        drive = load_drive(arguments.camera_of)
        trajectory = of_camera(trajectory, drive.camera.T_body_camera)
        of_what = f"the left camera of {drive.name}"
    written = write_trajectory(
        arguments.output, trajectory, arguments.format, force=arguments.force
    )
    names = ", ".join(map(str, written))
    answer(f"{names}: {len(trajectory)} poses of {of_what}")
    return OK


def _trajectory(path: Path, estimate: str) -> Trajectory:
    if path.is_file():
        if estimate != "filtered":
            raise VislamError(f"{path}: holds one trajectory: leave --estimate {estimate} out")
        return read_trajectory(path)
    results = read_results(path)
    found = {
        "filtered": results.trajectory,
        "smoothed": results.smoothed,
        "dead-reckoning": results.dead_reckoning,
    }[estimate]
    if found is None:
        raise VislamError(
            f"{path}: holds no {estimate} trajectory"
            + (": add --smooth to solve" if estimate == "smoothed" else "")
        )
    return found
