# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The largest rate that the graph keeps up with, for each number of features in a frame."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from reliability.load.latency import whole_latency
from reliability.load.play import play_heard
from vislam_ros.data.bags.layout import FEATURES
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

_DRIVE_RATE = 10.0  # frames a second of a simulated drive
_TRACKS_A_FEATURE = 13.0  # steps that a simulated track is seen in the mean
# Fewer frames than this waiting is a graph at work, not one that falls behind.
_MOST_PERIODS = 2.0


@dataclass(frozen=True)
class CurvePoint:
    """How the graph took so many features at such a rate.

    Attributes
    ----------
    features : float
        In a frame, in the mean.
    size : float
        Bytes of a features message, in the mean.
    rate : float
        Frames a second.
    frames, answered : int
    latency_ms : float
        From publishing the features to hearing the odometry, median of the last third.
    worst_ms : float
        The longest in the last third.
    """

    features: float
    size: float
    rate: float
    frames: int
    answered: int
    latency_ms: float
    worst_ms: float

    @property
    def keeps_up(self) -> bool:
        """Whether all is answered, and fewer than two frames wait at the end."""
        behind = self.latency_ms * 1e-3 * self.rate
        return self.answered == self.frames and behind < _MOST_PERIODS

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {**asdict(self), "keeps_up": self.keeps_up}


def largest_rates(points: Sequence[CurvePoint]) -> dict[float, float]:
    """The largest rate below which each tried one is kept up with, by features; 0 for none."""
    largest: dict[float, float] = {}
    for features in sorted({point.features for point in points}):
        largest[features] = 0.0
        for point in sorted(
            (p for p in points if p.features == features), key=lambda point: point.rate
        ):
            if not point.keeps_up:
                break
            largest[features] = point.rate
    return largest


def drive_with(features: int, frames: int) -> Drive:
    """A simulated drive with about so many features in a frame."""
    tracks = max(1, round(features * frames / _TRACKS_A_FEATURE))
    return simulate(SimulationSettings(steps=frames, landmarks=tracks)).drive


def measure_features(
    features: int, rates: Sequence[float], seconds: float, scratch: Path
) -> list[CurvePoint]:
    """Play a drive at each of the rates (Hz) for some seconds, up to one that is too fast."""
    bag = scratch / f"bag_{features}"
    drive = drive_with(features, max(2, round(max(rates) * seconds)))
    write_bag(drive, bag)
    points = []
    for rate in sorted(rates):
        heard = play_heard(
            bag,
            scratch / f"run_{features}_{rate:g}",
            rate / _DRIVE_RATE,
            duration=rate * seconds / _DRIVE_RATE,
        )
        latency = whole_latency(heard.messages)
        frames = heard.messages[FEATURES.name]
        last = latency[-max(1, len(latency) // 3) :]
        points.append(
            CurvePoint(
                features=round(len(drive.ids) / drive.steps, 1),
                size=float(np.mean([one.size for one in frames.values()])),
                rate=rate,
                frames=len(frames),
                answered=len(latency),
                latency_ms=float(np.median(last)) if len(last) else float("nan"),
                worst_ms=float(np.max(last)) if len(last) else float("nan"),
            )
        )
        if not points[-1].keeps_up:
            break
    return points
