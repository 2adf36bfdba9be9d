# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What one run amounts to: the numbers of ``summary.json``, gathered step by step."""

import json
import time
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vislam_ros.errors import VislamError


@dataclass(frozen=True)
class StepStatistics:
    """One row of ``steps.csv``; the fields are its columns.

    Attributes
    ----------
    stamp : int
        Nanoseconds.
    frozen : bool
        Whether the frame repeated its last pixels and was not used.
    active : int
        Landmarks in the dense block after the step.
    used, rejected, observed, admitted : int
        Observations that corrected the state, that failed a gate, that came, and that began a
        landmark.
    landmarks : int
        Landmarks in the whole map.
    nis : float
        Normalised innovation squared of the used observations together.
    nis_dof : int
        Its degrees of freedom.
    ms : float
        Time the step took, milliseconds.
    """

    stamp: int
    frozen: bool
    active: int
    used: int
    rejected: int
    observed: int
    admitted: int
    landmarks: int
    nis: float
    nis_dof: int
    ms: float


@dataclass
class RunSummary:
    """Gathers a run's numbers; whoever runs the estimator sets what only they know.

    Attributes
    ----------
    started : float
        ``time.monotonic()`` at the start of the whole command.
    drive, estimator : str or None
        Names of the drive and of the filter.
    gyro_bias : iterable of float, (3,), or None
        Last estimate, rad/s.
    landmarks, tracks : int or None
        Map points, and the different ids among them.
    peak_rss_mb : float or None
        Of the process that ran the estimator (see :func:`peak_rss_mb`).
    resets : int
        How often the estimate began anew.
    refused : mapping of str to int
        Messages that were refused, by stream and reason (see core.tracking.refusals).
    refused_first : mapping of str to str
        Stamp (s) of the first of them, where it has one.
    latencies_ms : array of float
        From sending features to hearing their pose, where it was measured.
    """

    started: float = field(default_factory=time.monotonic)
    drive: str | None = None
    estimator: str | None = None
    gyro_bias: Iterable[float] | None = None
    landmarks: int | None = None
    tracks: int | None = None
    peak_rss_mb: float | None = None
    resets: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)
    refused_first: Mapping[str, str] = field(default_factory=dict)
    latencies_ms: "array[float]" = field(default_factory=lambda: array("d"))
    complete: bool = False
    incomplete_reason: str | None = "the run has not ended"
    _steps: int = 0
    _frozen: int = 0
    _observations: int = 0
    _used: int = 0
    _rejected: int = 0
    _nis: float = 0.0
    _nis_dof: int = 0
    _step_ms: "array[float]" = field(default_factory=lambda: array("d"))
    _first: tuple[int, float] | None = None  # stamp and time.monotonic()
    _last: tuple[int, float] | None = None

    def add_pose(self, stamp: int) -> None:
        """Count a pose with this stamp in nanoseconds."""
        self._last = (stamp, time.monotonic())
        self._first = self._first or self._last
        self._steps += 1

    def add_statistics(self, statistics: StepStatistics) -> None:
        """Count what a step did."""
        self._frozen += statistics.frozen
        self._observations += statistics.observed
        self._used += statistics.used
        self._rejected += statistics.rejected
        self._nis += statistics.nis
        self._nis_dof += statistics.nis_dof
        self._step_ms.append(statistics.ms)
        self.landmarks = statistics.landmarks

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as JSON takes it; None stands for what is not known.

        ``rejected_fraction`` is the share of the observations put to the gate that failed it,
        ``nis_per_dof`` the normalised innovation squared of all others by their number,
        ``drive_s`` the time from the first to the last stamp, ``wall_s`` the time that passed
        meanwhile, and ``realtime_factor`` how much faster than the drive that was.
        """
        wall_s = drive_s = 0.0
        if self._first and self._last:
            drive_s = (self._last[0] - self._first[0]) * 1e-9
            wall_s = self._last[1] - self._first[1]
        gated = self._used + self._rejected
        return {
            "drive": self.drive,
            "estimator": self.estimator,
            "steps": self._steps,
            "frozen_steps": self._frozen,
            "gyro_bias": None if self.gyro_bias is None else [float(b) for b in self.gyro_bias],
            "landmarks": self.landmarks,
            "tracks": self.tracks,
            "observations": self._observations,
            "rejected_fraction": self._rejected / gated if gated else None,
            "nis_per_dof": self._nis / self._nis_dof if self._nis_dof else None,
            "wall_s": wall_s,
            "total_s": time.monotonic() - self.started,
            "drive_s": drive_s,
            "realtime_factor": drive_s / wall_s if wall_s else None,
            "step_ms_p50": _percentile(self._step_ms, 50),
            "step_ms_p99": _percentile(self._step_ms, 99),
            "latency_ms_p50": _percentile(self.latencies_ms, 50),
            "latency_ms_p99": _percentile(self.latencies_ms, 99),
            "peak_rss_mb": self.peak_rss_mb,
            "resets": self.resets,
            "refused": dict(self.refused),
            "refused_first": dict(self.refused_first),
            "complete": self.complete,
            "incomplete_reason": self.incomplete_reason,
        }


def _percentile(values: "array[float]", percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None


def read_summary(path: Path) -> dict[str, Any]:
    """Read ``summary.json``.

    Raises
    ------
    VislamError
        Where it is missing or no JSON object.
    """
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise VislamError(f"{path}: cannot read this summary: {error.strerror}") from error
    except ValueError as error:
        raise VislamError(f"{path}: not a JSON file: {error}") from error
    if not isinstance(summary, dict):
        raise VislamError(f"{path}: not a summary: it must hold one JSON object")
    return summary


def peak_rss_mb(process: int | str = "self") -> float | None:
    """Most memory that a running process ever held, megabytes; None where Linux cannot tell."""
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    for line in status.splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return None
