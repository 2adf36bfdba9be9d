# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives whose tracks the front end makes, of simulated and of recorded images."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmark.battery.rows import images_beside
from vislam_ros.data.drive import Drive
from vislam_ros.data.images.stereo_images import Motion, RawImage, StereoImages
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.data.loading import load_drive
from vislam_ros.data.simulation.images.simulated import SimulatedImages, simulate_images
from vislam_ros.data.trajectory import Trajectory, read_tum

#: What makes images hard: a long exposure that errs, and things that move.
HARD: dict[str, Any] = {"exposure_time": 0.01, "exposure_changes": True, "moving_objects": 8}
_SECONDS = 8.0

# The dataset and the reference of the recorded images.
_DRIVE = "0020"


def simulated_images(scene: str, seed: int, *, hard: bool) -> Drive:
    """Tracks of a simulated scene, with its twists and its truth."""
    values = {"scene": scene, "seconds": _SECONDS, "seed": seed, **(HARD if hard else {})}
    simulated = simulate_images(**values)
    images = StereoImages(
        name=scene,
        rig=simulated.rig,
        stamps=simulated.stamps,
        places=range(len(simulated)),
        reader=lambda places: _drawn(simulated, places),
        motion=Motion(simulated.stamps, simulated.twists),
        ground_truth=simulated.trajectory,
    )
    return tracked_drive(images)


def _drawn(
    simulated: SimulatedImages, places: Sequence[int]
) -> Iterator[tuple[RawImage, RawImage]]:
    for k in places:
        left, right = simulated.frame(k)
        yield RawImage(left, "mono8"), RawImage(right, "mono8")


def recorded_images(data: Path) -> tuple[Drive, Trajectory]:
    """Tracks of the recorded images that lie beside the datasets, and their reference."""
    motion = data / f"{_DRIVE}.npz"
    drive = load_drive(images_beside(data), motion=motion)
    return drive, read_tum(data / "ground_truth" / f"{_DRIVE}.tum")
