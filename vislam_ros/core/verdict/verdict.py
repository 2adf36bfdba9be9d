# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether an estimate can be trusted, and why not, judged step by step.

It looks at what the filter did with its observations, at how long vision was missing, and at what
images and twists say of each other whatever filter runs (see contradiction). Two things are told:
the verdict on all steps so far, and what is wrong at present. Both follow from the steps alone, so
they are the same live and offline.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.motion import Increment
from vislam_ros.core.verdict.contradiction import contradictions
from vislam_ros.core.verdict.evidence import Evidence, Looks
from vislam_ros.core.verdict.reason import Judgement, Reason, Word

# What is wrong at present shows in the last so many nanoseconds, or in so many steps at most.
_PRESENT, _MOST_STEPS = 30_000_000_000, 4096
# Vision that is missing for longer leaves the estimate to dead reckoning [ns].
_LONG = 3_000_000_000
# Shares of the observations: rejected ones that are doubtful, and that contradict the rest.
_REJECTED, _MOSTLY = 0.1, 0.5
# NIS by its degrees of freedom. Noise that is learned keeps it at 1 where the model holds.
_NIS = 1.2
# Standard deviations by which a count is beyond chance.
_BEYOND_CHANCE = 4.0
# With fewer steps looked at, or fewer disparities, nothing is said of them.
_FEWEST_LOOKS, _FEWEST_DISPARITIES = 8, 50


@dataclass(slots=True)
class _Count:
    """What many steps did.

    ``excess`` is NIS minus its degrees of freedom, ``scatter`` the sum of its squares.
    """

    steps: int = 0
    corrected: int = 0
    used: int = 0
    rejected: int = 0
    dof: int = 0
    excess: float = 0.0
    scatter: float = 0.0

    def add(self, used: int, rejected: int, nis: float, dof: int) -> None:
        """Count a step."""
        self.steps += 1
        self.corrected += used > 0
        self.used += used
        self.rejected += rejected
        self.dof += dof
        self.excess += nis - dof
        self.scatter += (nis - dof) * (nis - dof)


class _Gap(NamedTuple):
    """A stretch without vision: its length and its begin [ns], and whether frames contradicted it.

    A frame of which no more is used than rejected is none that vision could correct.
    """

    length: int = 0
    begin: int = 0
    contradicted: bool = False


class Verdict:
    """Judges the steps of one pass.

    Parameters
    ----------
    camera : StereoCamera
        As it was given.
    """

    def __init__(self, camera: StereoCamera):
        self._camera = camera
        self._evidence = Evidence()
        self._total = _Count()
        # Stamp, used, rejected, NIS and its degrees of freedom.
        self._latest: deque[tuple[int, int, int, float, int]] = deque(maxlen=_MOST_STEPS)
        self._begin = self._end = self._seen = 0
        self._gap, self._contradicted = _Gap(), False
        self._known: dict[bool, tuple[tuple[int, int], tuple[Reason, ...]]] = {}

    def add(
        self,
        stamp: int,
        ids: NDArray[np.uint32],
        pixels: NDArray[np.float32],
        increment: Increment,
        outcome: Outcome,
        *,
        frozen: bool,
    ) -> None:
        """Take a step (its stamp in ns): frame (n,), (n, 4), predicted motion, and outcome."""
        if not self._total.steps:
            self._begin = self._seen = stamp
        self._end = stamp
        used, rejected = outcome.used, len(outcome.rejected)
        if outcome.agrees_with_most:
            self._gap = self._longest_gap(stamp)
            self._seen, self._contradicted = stamp, False
        elif outcome.is_contradicted:
            self._contradicted = True
        nis, dof = float(outcome.nis), outcome.nis_dof
        self._total.add(used, rejected, nis, dof)
        self._latest.append((stamp, used, rejected, nis, dof))
        self._evidence.add(stamp, ids, pixels, increment, self._camera, frozen=frozen)

    def judged(self, until: int | None = None) -> Judgement:
        """Judge all steps so far.

        Parameters
        ----------
        until : int, optional
            Stamp (ns) up to which the motion is known: frames may be missing since the last step.
        """
        total = self._total
        rarely = tuple(_of_corrections(total))
        return Judgement.of(
            self._end,
            (
                *self._of_images(None),
                *_of_counts(total),
                *(rarely or self._of_gap(self._longest_gap(self._until(until)))),
            ),
        )

    def present(self, until: int | None = None) -> Judgement:
        """Judge what is wrong now: the last half minute."""
        end = self._until(until)
        since = end - _PRESENT
        recent = _Count()
        for stamp, used, rejected, nis, dof in reversed(self._latest):
            if stamp < since:
                break
            recent.add(used, rejected, nis, dof)
        return Judgement.of(
            self._end,
            (
                *self._of_images(since),
                *_of_counts(recent),
                *self._of_gap(self._latest_gap(end)),
            ),
        )

    def _until(self, until: int | None) -> int:
        return self._end if until is None else max(until, self._end)

    def _latest_gap(self, until: int) -> _Gap:
        return _Gap(until - self._seen, self._seen, self._contradicted)

    def _longest_gap(self, until: int) -> _Gap:
        return max(self._gap, self._latest_gap(until), key=lambda gap: gap.length)

    def _of_images(self, since: int | None) -> tuple[Reason, ...]:
        """Reasons in the images; found anew only where there is more to look at."""
        evidence = self._evidence
        looks = evidence.looks if since is None else evidence.looks_since(since)
        pairs = evidence.pairs(since)
        known, reasons = self._known.get(since is None, (None, ()))
        if known != (evidence.gathered, len(pairs)):
            reasons = tuple(contradictions(pairs, self._camera))
            self._known[since is None] = ((evidence.gathered, len(pairs)), reasons)
        # What the images themselves contradict is no test of the twists.
        return tuple(_of_looks(looks)) or reasons

    def _of_gap(self, gap: _Gap) -> Iterator[Reason]:
        if gap.length > _LONG:
            missing = "missing or contradicted" if gap.contradicted else "missing"
            yield Reason(
                Word.DOUBTFUL,
                f"vision was {missing} for {gap.length * 1e-9:.1f} s, "
                f"{(gap.begin - self._begin) * 1e-9:.1f} s after the start: the motion of that "
                "time is dead reckoning's",
            )


def _of_looks(looks: Looks) -> Iterator[Reason]:
    """Yield what is wrong with the images alone."""
    disparities = looks.positive + looks.negative
    if disparities >= _FEWEST_DISPARITIES and looks.negative > _MOSTLY * disparities:
        yield Reason(
            Word.CONTRADICTION,
            f"{looks.negative / disparities:.0%} of the disparities are negative: left and right "
            "images seem to be exchanged",
        )
    steps = looks.rigid + looks.loose
    if steps >= _FEWEST_LOOKS and looks.loose > _MOSTLY * steps:
        yield Reason(
            Word.CONTRADICTION,
            f"in {looks.loose / steps:.0%} of the frames looked at the tracks do not move as one "
            "scene: check their ids and the stereo matching",
        )


def _of_counts(count: _Count) -> Iterator[Reason]:
    """Yield what the filter's own figures say."""
    gated = count.used + count.rejected
    certain = count.rejected - _BEYOND_CHANCE * math.sqrt(count.rejected)
    if certain > _REJECTED * gated:
        yield Reason(
            Word.CONTRADICTION if certain > _MOSTLY * gated else Word.DOUBTFUL,
            f"{count.rejected / gated:.0%} of the observations were rejected: tracks, their ids, "
            "twists and calibration do not agree",
        )
    if count.excess > max((_NIS - 1.0) * count.dof, _BEYOND_CHANCE * math.sqrt(count.scatter)):
        yield Reason(
            Word.DOUBTFUL,
            f"NIS per degree of freedom is {1.0 + count.excess / count.dof:.2f}: the estimate is "
            "worse than its covariance says",
        )


def _of_corrections(count: _Count) -> Iterator[Reason]:
    if count.steps >= _FEWEST_LOOKS and count.corrected < (1.0 - _MOSTLY) * count.steps:
        yield Reason(
            Word.DOUBTFUL,
            f"vision corrected the estimate in {count.corrected} of {count.steps} frames only: "
            "most of its motion is dead reckoning's",
        )
