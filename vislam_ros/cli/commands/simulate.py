# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam simulate``: a drive with exact ground truth, as tracks or as images."""

import argparse
import dataclasses
from collections.abc import Iterable
from typing import Any

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer, tell_next
from vislam_ros.cli.screen import progress_bar
from vislam_ros.core.settings import settings_from_dict
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.images.folder import TRUTH, write_image_folder
from vislam_ros.data.simulation.images.simulated import ImageSettings, simulate_images
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    along = read_trajectory(arguments.along) if arguments.along else None
    of_tracks, of_images = _names(SimulationSettings), _names(ImageSettings)
    if arguments.images:
        _refuse(arguments, of_tracks - of_images, "is of tracks: leave it or --images out")
        return _write_images(arguments, _given(arguments, of_images), along)
    _refuse(arguments, of_images - of_tracks, "is of images: add --images")
    return _write_tracks(arguments, _given(arguments, of_tracks), along)


def _write_tracks(
    arguments: argparse.Namespace, values: dict[str, Any], along: Trajectory | None
) -> int:
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


def _write_images(
    arguments: argparse.Namespace, values: dict[str, Any], along: Trajectory | None
) -> int:
    simulated = simulate_images(settings_from_dict(ImageSettings, values), along)
    with progress_bar("drawing", len(simulated)) as update:
        write_image_folder(
            arguments.output,
            simulated,
            force=arguments.force,
            progress=lambda done: update(done, ""),
        )
    answer(
        f"{arguments.output}: {len(simulated)} stereo frames of a {simulated.settings.scene}; "
        f"truth in {arguments.output / TRUTH}"
    )
    tell_next("run", str(arguments.output), "--out", f"results/{arguments.output.stem}")
    return OK


def _names(settings: type[SimulationSettings] | type[ImageSettings]) -> set[str]:
    return {field.name for field in dataclasses.fields(settings)}


def _given(arguments: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Settings that have a flag, where it was given."""
    return {
        name: getattr(arguments, name)
        for name in names
        if getattr(arguments, name, None) is not None
    }


def _refuse(arguments: argparse.Namespace, names: Iterable[str], why: str) -> None:
    for name in sorted(_given(arguments, names)):
        raise VislamError(f"{arguments.flags[name]}: {why}")
