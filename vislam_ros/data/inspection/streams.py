# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A stream's stamps: its rate, and what is wrong with them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD
from vislam_ros.data.finding import Finding

Stamps = NDArray[np.int64]

# A frame is missing where at least most of a second period passes, and no jitter explains it.
_GAP_PERIODS, _GAP_STD = 1.75, 6.0
# Times that scatter by more of a period are those of a clock on the way, not of the sensor.
_JITTER = 0.1
_FEWEST = 5
_NANOSECONDS = 1e-9


@dataclass(frozen=True)
class Stream:
    """What the stamps of a stream amount to.

    Attributes
    ----------
    name : str
    count : int
    rate : float
        A second, by the median step; 0 for fewer than two stamps.
    begin, end : int
        First and last of them by time, nanoseconds.
    jitter : float
        Standard deviation of a step, seconds, whatever few steps are far off.
    zeros, duplicates, late : int
        Stamps that are zero, that repeat another one, and that are before one that came earlier.
    late_by : float
        The most by which one is late, seconds.
    gaps : tuple of (int, float)
        Stamp before each gap, nanoseconds, and how long it is, seconds.
    """

    name: str
    count: int
    rate: float = 0.0
    begin: int = 0
    end: int = 0
    jitter: float = 0.0
    zeros: int = 0
    duplicates: int = 0
    late: int = 0
    late_by: float = 0.0
    gaps: tuple[tuple[int, float], ...] = ()

    @classmethod
    def of(cls, name: str, stamps: Stamps) -> "Stream":
        """Stream of stamps (n,) in the order in which they were recorded, nanoseconds."""
        if not len(stamps):
            return cls(name, 0)
        zeros = int(np.sum(stamps <= 0))
        latest = np.maximum.accumulate(stamps)
        behind = (latest - stamps) * _NANOSECONDS
        times = np.unique(stamps[stamps > 0])
        begin, end = (int(times[0]), int(times[-1])) if len(times) else (0, 0)
        duplicates = len(stamps) - zeros - len(times)
        late = int(np.sum(behind[stamps > 0] > 0))
        late_by = float(behind[stamps > 0].max(initial=0.0))
        gaps: tuple[tuple[int, float], ...] = ()
        if len(times) < 2:
            rate, jitter = 0.0, 0.0
        else:
            steps = np.diff(times) * _NANOSECONDS
            period = float(np.median(steps))
            jitter = MEDIAN_TO_STD * float(np.median(np.abs(steps - period)))
            long = steps > max(_GAP_PERIODS * period, period + _GAP_STD * jitter)
            rate = 1.0 / period
            gaps = tuple(
                zip(times[:-1][long].tolist(), (steps[long] - period).tolist(), strict=True)
            )
        return cls(
            name, len(stamps), rate, begin, end, jitter, zeros, duplicates, late, late_by, gaps
        )

    def as_dict(self) -> dict[str, Any]:
        """The figures, for JSON; times in seconds."""
        return {
            "count": self.count,
            "rate_hz": self.rate,
            "begin_s": self.begin * _NANOSECONDS,
            "end_s": self.end * _NANOSECONDS,
            "jitter_s": self.jitter,
            "zeros": self.zeros,
            "duplicates": self.duplicates,
            "late": self.late,
            "late_by_s": self.late_by,
            "gaps": len(self.gaps),
            "longest_gap_s": max((length for _, length in self.gaps), default=0.0),
        }

    def faults(self) -> Iterator[tuple[str, bool]]:
        """Yield what is wrong with them in words, and whether reading lives with it."""
        if self.zeros:
            yield f"{self.zeros} of {self.count} stamps of {self.name} are zero", False
        if self.duplicates:
            yield f"{self.duplicates} stamps of {self.name} repeat another", True
        if self.late:
            yield (
                f"{self.late} of {self.count} {self.name} come up to {self.late_by:.2g} s "
                "after a newer one",
                True,
            )
        if self.gaps:
            longest = max(length for _, length in self.gaps)
            yield f"gaps in {self.name}: {len(self.gaps)}, of {longest:.2g} s at most", True
        if self.count >= _FEWEST and self.jitter * self.rate > _JITTER:
            yield (
                f"steps of {self.name} scatter by {1e3 * self.jitter:.1f} ms about "
                f"{1e3 / self.rate:.1f} ms",
                False,
            )


def judge_stamps(streams: Sequence[Stream]) -> Finding | None:
    """Tell what is wrong with the stamps of some streams; None where nothing is."""
    faults = [(words, lives, each) for each in streams for words, lives in each.faults()]
    if not faults:
        return None
    is_repaired = all(lives for _, lives, _ in faults)
    advice = (
        "sorted by stamp; across gaps the motion carries the estimate"
        if is_repaired
        else "check where the stamps are made: they are to be the moments of measurement"
    )
    return Finding(
        "stamps",
        "; ".join(words for words, _, _ in faults),
        advice,
        is_repaired,
        {each.name: each.as_dict() for _, _, each in faults},
    )
