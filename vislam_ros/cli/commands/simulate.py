# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam simulate``: a drive with exact ground truth."""

import argparse
import dataclasses

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer, tell_next
from vislam_ros.core.settings import settings_from_dict
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.trajectory_files import read_trajectory


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    names = [field.name for field in dataclasses.fields(SimulationSettings)]
    given = {name: getattr(arguments, name) for name in names}
    values = {name: value for name, value in given.items() if value is not None}
    along = read_trajectory(arguments.along) if arguments.along else None
    if along is not None:
        values.setdefault("steps", len(along))
    simulated = simulate(settings_from_dict(SimulationSettings, values), along)
    truth = write_simulated(arguments.output, simulated, force=arguments.force)
    drive = simulated.drive
    answer(
        f"{arguments.output}: {drive.steps} steps, {drive.tracks} tracks, "
        f"{int(simulated.frozen.sum())} frozen steps; truth in {truth}"
    )
    tell_next("run", str(arguments.output), "--out", f"results/{arguments.output.stem}")
    return OK
