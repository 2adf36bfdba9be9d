# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives with a hole in them: features or twists missing for a while.

Across a hole the estimate has only the other of its two sources, so it is held against what that
one alone would have had: dead reckoning where features are missing, the undisturbed estimate
where twists are.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.association import associate_stamps
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.evaluation.relative import relative_errors
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.worker_pool import available_cores, in_processes
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory

KINDS = ("features", "twists")

# What the hole has done to the estimate shows by then [s].
_AFTER = 0.5


@dataclass(frozen=True)
class Outage:
    """A hole in a drive.

    Attributes
    ----------
    kind : str
        ``features`` or ``twists``.
    place : float
        Where it begins, as a share of the drive's duration.
    seconds : float
    """

    kind: str
    place: float
    seconds: float

    def span(self, drive: Drive) -> tuple[int, int]:
        """First stamp (ns) that is missing, and the first that is there again."""
        begin = int(drive.feature_stamps[0] + self.place * drive.duration * NANOSECONDS)
        return begin, begin + round(self.seconds * NANOSECONDS)

    def applied(self, drive: Drive) -> Drive:
        """Leave the messages out."""
        begin, end = self.span(drive)
        if self.kind == "twists":
            kept = (drive.twist_stamps < begin) | (drive.twist_stamps >= end)
            return dataclasses.replace(
                drive, twist_stamps=drive.twist_stamps[kept], twists=drive.twists[kept]
            )
        return drive.with_frames((drive.feature_stamps < begin) | (drive.feature_stamps >= end))


@dataclass(frozen=True)
class OutageRow:
    """What a hole has cost.

    Attributes
    ----------
    outage : Outage
    gap_m : float
        Error of the estimated motion from before the hole to after it, metres.
    beside_m : float
        The same of what is left: dead reckoning, or the undisturbed estimate.
    ate_ratio, nees_ratio : float
        Over the undisturbed estimate's.
    beside_ate_ratio : float
        The same of the undisturbed estimate whose motion across the hole is that of what is left.
    """

    outage: Outage
    gap_m: float
    beside_m: float
    ate_ratio: float
    nees_ratio: float
    beside_ate_ratio: float

    @property
    def bound_m(self) -> float:
        """What the gap may cost."""
        return 1.2 * self.beside_m + 0.3

    @property
    def holds(self) -> bool:
        """Whether the estimate is no worse than what is left."""
        return self.gap_m <= self.bound_m

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON takes it."""
        return {**dataclasses.asdict(self), "bound_m": self.bound_m, "holds": self.holds}


@dataclass(frozen=True)
class _Shared:
    drive: Drive
    reference: Trajectory
    slam: SlamSettings
    prediction: PredictionSettings


@dataclass(frozen=True)
class _Judged:
    trajectory: Trajectory
    dead_reckoning: Trajectory
    ate: float
    nees: float


def outages(places: int, seconds: Sequence[float]) -> list[Outage]:
    """Holes of each kind and length at places spread over a drive."""
    shares = (np.arange(places) + 0.5) / (places + 0.5)
    return [Outage(kind, float(p), s) for kind in KINDS for s in seconds for p in shares]


def measure_outages(
    drive: Drive,
    reference: Trajectory,
    slam: SlamSettings,
    prediction: PredictionSettings,
    tasks: Sequence[Outage],
) -> Iterator[OutageRow]:
    """Solve a drive with each of the holes, on all cores; yield the rows as they come.

    Parameters
    ----------
    drive : Drive
    reference : Trajectory
    slam, prediction : SlamSettings, PredictionSettings
    tasks : sequence of Outage
    """
    shared = _Shared(drive, reference, slam, prediction)
    undisturbed = _judged(shared, drive)
    for index, outcome in in_processes(_judge_outage, shared, tasks, available_cores()):
        if isinstance(outcome, Exception):
            raise outcome
        yield _row(shared, undisturbed, tasks[index], outcome)


def _judge_outage(shared: _Shared, outage: Outage) -> _Judged:
    return _judged(shared, outage.applied(shared.drive))


def _judged(shared: _Shared, drive: Drive) -> _Judged:
    solution = solve(drive, shared.slam, shared.prediction)
    trajectory = solution.trajectory
    figures = compare(shared.reference, trajectory, trajectory.covariances)
    return _Judged(
        trajectory,
        solution.dead_reckoning,
        figures["ate_m"]["rmse"],
        figures["nees_per_dof"],
    )


def _row(shared: _Shared, undisturbed: _Judged, outage: Outage, judged: _Judged) -> OutageRow:
    begin, end = outage.span(shared.drive)
    stamps = np.array([begin, end + round(_AFTER * NANOSECONDS)])
    left = undisturbed.dead_reckoning if outage.kind == "features" else undisturbed.trajectory
    return OutageRow(
        outage,
        _motion_error(shared.reference, judged.trajectory, stamps),
        _motion_error(shared.reference, left, stamps),
        judged.ate / undisturbed.ate,
        judged.nees / undisturbed.nees,
        _ate(shared.reference, _spliced(undisturbed.trajectory, left, stamps)) / undisturbed.ate,
    )


def _ate(reference: Trajectory, estimate: Trajectory) -> float:
    return float(compare(reference, estimate)["ate_m"]["rmse"])


def _spliced(estimate: Trajectory, left: Trajectory, span: NDArray[np.int64]) -> Trajectory:
    """Estimate whose motion across a span (ns) is that of another trajectory at its stamps."""
    first, last = _ends(estimate.stamps, span)
    begin, end = (left.T_world_body[k] for k in _ends(left.stamps, span))
    T = estimate.T_world_body.copy()
    T[last:] = T[first] @ np.linalg.inv(begin) @ end @ np.linalg.inv(T[last]) @ T[last:]
    return Trajectory.from_matrices(estimate.stamps, T)


def _ends(stamps: NDArray[np.int64], span: NDArray[np.int64]) -> tuple[int, int]:
    """Which of some stamps is the last before a span (ns), and which the first after it."""
    first = max(int(np.searchsorted(stamps, span[0])) - 1, 0)
    return first, min(int(np.searchsorted(stamps, span[1])), len(stamps) - 1)


def _motion_error(reference: Trajectory, estimate: Trajectory, span: NDArray[np.int64]) -> float:
    """Error of the motion from the last pose before a span (ns) to the first one after it."""
    i, j = associate_stamps(reference.stamps, estimate.stamps)
    pair = np.array([_ends(estimate.stamps[j], span)])
    metres, _ = relative_errors(reference.T_world_body[i], estimate.T_world_body[j], pair)
    return float(metres[0])
