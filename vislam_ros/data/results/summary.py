# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What one run amounts to: the numbers of ``summary.json``, gathered step by step."""

import math
import reprlib
import time
from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vislam_ros.core.filters.quantities import GYRO_BIAS
from vislam_ros.core.step import Row, StepTotals, estimates_of, percentile
from vislam_ros.core.tracking.refusals import RefusalCounts
from vislam_ros.core.verdict.reason import Judgement
from vislam_ros.data.files.json_file import read_json
from vislam_ros.data.results.completeness import lost_frames
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.errors import VislamError


@dataclass
class RunSummary:
    """Gathers a run's numbers; whoever runs the estimator sets what only they know.

    Attributes
    ----------
    started : float
        ``time.monotonic()`` at the start of the whole command.
    drive, estimator : str or None
        Names of the drive and of the filter.
    landmarks, tracks : int or None
        Map points, and the different ids among them.
    peak_rss_mb : float or None
        Of the process that ran the estimator (see :func:`peak_rss_mb`).
    resets : int
        How often the estimate began anew.
    parameter_changes : int
        Parameters that were changed while it ran.
    refused : mapping of str to int
        Messages that were refused, by stream and reason (see core.tracking.refusals).
    refused_first : mapping of str to str
        Stamp (s) of the first of them, where it has one.
    refused_before : mapping of str to int
        Those among ``refused`` that the passes before had.
    latencies_ms : array of float
        From sending features to hearing their pose, where it was measured.
    verdict : Judgement or None
        Whether the estimate can be trusted; None where there is no step.
    """

    started: float = field(default_factory=time.monotonic)
    drive: str | None = None
    estimator: str | None = None
    landmarks: int | None = None
    tracks: int | None = None
    peak_rss_mb: float | None = None
    resets: int = 0
    parameter_changes: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)
    refused_first: Mapping[str, str] = field(default_factory=dict)
    refused_before: Mapping[str, int] = field(default_factory=dict)
    latencies_ms: "array[float]" = field(default_factory=lambda: array("d"))
    verdict: Judgement | None = None
    complete: bool = False
    incomplete_reason: str | None = "the run has not ended"
    _totals: StepTotals = field(default_factory=StepTotals)
    _estimates: Mapping[str, float] = field(default_factory=dict)
    _first: tuple[int, float] | None = None  # stamp and time.monotonic()
    _last: tuple[int, float] | None = None

    def add_step(self, row: Row) -> None:
        """Count a step."""
        self._last = (int(row["stamp"]), time.monotonic())
        self._first = self._first or self._last
        self._totals.add(row)
        self._estimates = estimates_of(row)
        self.landmarks = int(row["landmarks"])

    def set_refused(self, refused: RefusalCounts) -> None:
        """Tell which messages were refused."""
        self.refused = dict(sorted(refused.counts.items()))
        self.refused_first = {
            word: stamp_text(stamp) for word, stamp in sorted(refused.first_stamps.items())
        }

    def judge_lost_frames(self) -> None:
        """Let the verdict know of the frames that have no pose, when all were answered."""
        own = Counter(self.refused) - Counter(self.refused_before)
        first = {w: s for w, s in self.refused_first.items() if w not in self.refused_before}
        lost = lost_frames(self._totals.steps, own, first)
        if lost and self.verdict is not None:
            self.verdict = self.verdict.with_doubt(lost)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as JSON takes it; None stands for what is not known.

        ``docs/results.md`` says what each key means.
        """
        wall_s = drive_s = 0.0
        if self._first and self._last:
            drive_s = (self._last[0] - self._first[0]) * 1e-9
            wall_s = self._last[1] - self._first[1]
        totals = self._totals
        estimates = {name: _known(value) for name, value in self._estimates.items()}
        gyro_bias = [estimates.get(name) for name in GYRO_BIAS.names]
        return {
            "drive": self.drive,
            "estimator": self.estimator,
            "steps": totals.steps,
            "frozen_steps": totals.frozen_steps,
            "gyro_bias": None if None in gyro_bias else gyro_bias,
            "landmarks": self.landmarks,
            "tracks": self.tracks,
            "observations": totals.observations,
            "left_out": totals.left_out,
            "rejected_fraction": totals.rejected_fraction,
            "nis_per_dof": totals.nis_per_dof,
            "wall_s": wall_s,
            "total_s": time.monotonic() - self.started,
            "drive_s": drive_s,
            "realtime_factor": drive_s / wall_s if wall_s else None,
            "step_ms_p50": totals.ms_percentile(50),
            "step_ms_p99": totals.ms_percentile(99),
            "latency_ms_p50": percentile(self.latencies_ms, 50),
            "latency_ms_p99": percentile(self.latencies_ms, 99),
            "peak_rss_mb": self.peak_rss_mb,
            "resets": self.resets,
            "parameter_changes": self.parameter_changes,
            "refused": dict(self.refused),
            "refused_first": dict(self.refused_first),
            "verdict": self.verdict.word.value if self.verdict else None,
            "verdict_reasons": list(self.verdict.reasons) if self.verdict else [],
            "complete": self.complete,
            "incomplete_reason": self.incomplete_reason,
            "estimates": estimates,
        }


def _known(value: float) -> float | None:
    """JSON has no NaN and no infinity; such a number is not known."""
    return value if math.isfinite(value) else None


_NUMBER = (int, float, type(None))
_COUNT = (int, type(None))
_TEXT = (str, type(None))
# Types of what other modules read from a summary; an older one may lack some.
_TYPES: Mapping[str, tuple[type, ...]] = {
    **dict.fromkeys(("drive", "estimator", "incomplete_reason"), _TEXT),
    **dict.fromkeys(("steps", "frozen_steps", "landmarks", "tracks"), _COUNT),
    **dict.fromkeys(("observations", "left_out"), _COUNT),
    **dict.fromkeys(("rejected_fraction", "nis_per_dof", "wall_s", "total_s", "drive_s"), _NUMBER),
    **dict.fromkeys(("realtime_factor", "step_ms_p50", "step_ms_p99", "peak_rss_mb"), _NUMBER),
    **dict.fromkeys(("latency_ms_p50", "latency_ms_p99"), _NUMBER),
    **dict.fromkeys(("resets", "parameter_changes"), _COUNT),
    "gyro_bias": (list, type(None)),
    "refused": (dict,),
    "refused_first": (dict,),
    "estimates": (dict,),
    "complete": (bool,),
}


def read_summary(path: Path) -> dict[str, Any]:
    """Read ``summary.json``.

    Raises
    ------
    VislamError
        Where it is missing, is no JSON object, or a value has another type than it should.
    """
    summary = read_json(path, "this summary")
    for name, kinds in _TYPES.items():
        value = summary.get(name)
        # True is an int to Python.
        right = isinstance(value, kinds) and (isinstance(value, bool) <= (bool in kinds))
        if name in summary and not right:
            raise VislamError(f"{path}: {name} is {reprlib.repr(value)}, which it cannot be")
    return summary


def has_ended(summary: Mapping[str, Any]) -> bool:
    """Whether whoever writes a summary has said how the run ended."""
    return bool(
        summary["complete"] or summary["incomplete_reason"] != RunSummary.incomplete_reason
    )


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
