# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the verdict says of drives that are as they should be, and of disturbed ones."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmark.sensitivity.drives import KINDS

from reliability.disturbances import DISTURBANCES
from vislam_ros.core.verdict.reason import Word
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.worker_pool import available_cores, in_processes

UNDISTURBED = "none"

#: Shares of the tracks of undisturbed drives.
FRACTIONS = (1.0, 0.33, 0.1)

PARTS = ("whole", "quarters")
_QUARTERS = 4
_SIMULATED = {"steps": 300, "landmarks": 1320}


@dataclass(frozen=True)
class Trial:
    """A drive to judge.

    Attributes
    ----------
    drive : str
    quarter : int or None
        Which one of it, from 0; None for the whole.
    fraction : float
        Share of its tracks.
    disturbance : str
        Name of one of DISTURBANCES, or UNDISTURBED.
    """

    drive: str
    quarter: int | None = None
    fraction: float = 1.0
    disturbance: str = UNDISTURBED

    @property
    def part(self) -> str:
        """Which part of a drive it is, in a word."""
        return "whole" if self.quarter is None else "quarters"


@dataclass(frozen=True)
class VerdictRow:
    """What was said of a trial."""

    trial: Trial
    word: str
    reasons: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether nothing speaks against it."""
        return self.word == Word.GOOD.value

    @property
    def is_of_vision(self) -> bool:
        """Whether all that is said is that vision was missing."""
        return bool(self.reasons) and all(reason.startswith("vision") for reason in self.reasons)

    @property
    def is_named(self) -> bool:
        """Whether a reason says what was done."""
        named = DISTURBANCES[self.trial.disturbance].named
        return bool(named) and any(named in reason for reason in self.reasons)

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON takes it."""
        return dataclasses.asdict(self)


def simulated_drives() -> dict[str, Drive]:
    """Drives of all kinds that constants are tried on."""
    return {
        f"simulated, {kind}": simulate(**{**_SIMULATED, **own}).drive
        for kind, own in KINDS.items()
    }


def trials(
    drives: Sequence[str], disturbances: Sequence[str], parts: Sequence[str] = PARTS
) -> list[Trial]:
    """Every drive and each quarter of it: undisturbed with each share of tracks, and disturbed."""
    numbers: Mapping[str, Sequence[int | None]] = {"whole": [None], "quarters": range(_QUARTERS)}
    return [
        Trial(drive, number, fraction, disturbance)
        for drive in drives
        for disturbance in disturbances
        for part in parts
        for number in numbers[part]
        for fraction in (FRACTIONS if disturbance == UNDISTURBED else (1.0,))
    ]


def measure_verdicts(drives: Mapping[str, Drive], tasks: Sequence[Trial]) -> Iterator[VerdictRow]:
    """Solve and judge, on all cores; yield the rows as they come."""
    for _, row in in_processes(_judged, drives, tasks, available_cores()):
        if isinstance(row, Exception):
            raise row
        yield row


def _judged(drives: Mapping[str, Drive], trial: Trial) -> VerdictRow:
    drive = drives[trial.drive]
    if trial.quarter is not None:
        drive = quarter(drive, trial.quarter)
    if trial.disturbance != UNDISTURBED:
        drive = DISTURBANCES[trial.disturbance].change(drive)
    summary = solve(drive, feature_fraction=trial.fraction).summary
    return VerdictRow(trial, summary["verdict"], tuple(summary["verdict_reasons"]))


def quarter(drive: Drive, number: int) -> Drive:
    """Return a quarter of a drive, counted from 0."""
    first, last = (drive.steps * edge // _QUARTERS for edge in (number, number + 1))
    stamps = drive.feature_stamps[first:last]
    moving = (drive.twist_stamps >= stamps[0]) & (drive.twist_stamps <= stamps[-1])
    rows = slice(drive.offsets[first], drive.offsets[last])
    return dataclasses.replace(
        drive,
        twist_stamps=drive.twist_stamps[moving],
        twists=drive.twists[moving],
        feature_stamps=stamps,
        offsets=drive.offsets[first : last + 1] - np.int64(drive.offsets[first]),
        ids=drive.ids[rows],
        pixels=drive.pixels[rows],
        ground_truth=None,
    )
