# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives to try a constant on: simulated ones of several kinds, and recorded ones."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vislam_ros.data.datasets.conventions import AS_FOUND, settle_conventions
from vislam_ros.data.drive import Drive
from vislam_ros.data.loading import load_drive
from vislam_ros.data.simulation.simulate import (
    SimulationSettings,
    simulate,
)
from vislam_ros.data.simulation.simulated_drive import SimulatedLandmarks
from vislam_ros.data.trajectory import Trajectory, read_tum

#: What the kinds of simulated drives have, but for what each has of its own.
_USUAL = {"steps": 300, "landmarks": 1320}

#: Kind -> settings of its simulation.
KINDS: Mapping[str, Mapping[str, Any]] = {
    "quiet twist": {"velocity_noise_std": 0.02, "angular_velocity_noise_std": 0.003},
    "noisy twist, frozen steps": {
        "velocity_noise_std": 0.5,
        "angular_velocity_noise_std": 0.05,
        "frozen_share": 0.1,
    },
    # As on KITTI: tracks that hold well, and disparities that keep their error.
    "disparity offsets": {"pixel_noise_std": 0.2, "disparity_offset_std": 0.7},
    "noisy pixels, many outliers": {"pixel_noise_std": 2.0, "outlier_share": 0.1},
    "few tracks": {"landmarks": 330},
    # Longer than the memories.
    "long": {"steps": 900, "landmarks": 3960, "frozen_share": 0.1},
}

# Share of the tracks of a recorded drive with fewer.
_FEWER = 0.33


@dataclass(frozen=True)
class TrialDrive:
    """Where a drive comes from.

    Attributes
    ----------
    name : str
    simulation : SimulationSettings or None
    data, reference : Path or None
        Of a recorded one.
    feature_fraction : float
        Share of the tracks to use.
    """

    name: str
    simulation: SimulationSettings | None = None
    data: Path | None = None
    reference: Path | None = None
    feature_fraction: float = 1.0

    @property
    def group(self) -> str:
        """Whether it is simulated or recorded."""
        return "simulated" if self.simulation else "recorded"


@dataclass(frozen=True)
class LoadedDrive:
    """A drive with its truth; the landmarks' where it is simulated."""

    drive: Drive
    truth: Trajectory
    landmarks: SimulatedLandmarks | None


def load(trial: TrialDrive) -> LoadedDrive:
    """Make or read a drive, and settle its conventions as for any dataset."""
    if trial.simulation is not None:
        simulated = simulate(trial.simulation)
        drive = settle_conventions(simulated.drive, AS_FOUND)
        assert drive.ground_truth is not None
        return LoadedDrive(drive, drive.ground_truth, simulated.landmarks)
    assert trial.data is not None
    assert trial.reference is not None
    return LoadedDrive(load_drive(trial.data), read_tum(trial.reference), None)


def simulated_drives(seeds: int, shorter: int = 1) -> list[TrialDrive]:
    """One drive of each kind with each seed, the steps divided by ``shorter``."""
    drives = []
    for kind, own in KINDS.items():
        chosen = {**_USUAL, **own}
        chosen.update({name: chosen[name] // shorter for name in ("steps", "landmarks")})
        drives += [
            TrialDrive(f"{kind}, seed {seed}", SimulationSettings(**chosen, seed=seed))
            for seed in range(seeds)
        ]
    return drives


def recorded_drives(data: Iterable[Path]) -> list[TrialDrive]:
    """Drives with a reference beside them or in ``ground_truth``, whole and with fewer tracks.

    It may be a pseudo reference, whose name says so.
    """
    drives = []
    for path in data:
        names = (f"{path.stem}.tum", f"{path.stem}_pseudo.tum")
        folders = (path.parent, path.parent / "ground_truth")
        known = [folder / name for folder in folders for name in names]
        reference = next(filter(Path.is_file, known), None)
        if reference is not None:
            drives += [
                TrialDrive(path.stem, data=path, reference=reference),
                TrialDrive(
                    f"{path.stem}, a third of the tracks",
                    data=path,
                    reference=reference,
                    feature_fraction=_FEWER,
                ),
            ]
    return drives
