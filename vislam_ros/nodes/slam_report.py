# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node says of its steps: each on ``slam/steps``, all since the last on /diagnostics."""

import itertools
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rclpy.node import Node

from vislam_ros.core.step import KINDS, Row, SlamStep, StepTotals
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.core.verdict.reason import Judgement, Word
from vislam_ros.data.results.summary import peak_rss_mb
from vislam_ros.nodes.diagnostics import stamp_age, values_if_over
from vislam_ros.nodes.recorder.parameter_changes import Changes, change_values

if TYPE_CHECKING:
    # The recorder reads what is told here, and has no use for the estimators.
    from vislam_ros.core.slam import Slam

_ROW, _LATENCY = "row", "latency_ms"
_NUMBER = "number"
_PEAK_MEMORY, _RESETS = "peak memory [MB]", "resets"

#: Verdicts on /diagnostics: on the steps so far, and on those before the estimate began anew.
PRESENT, PREVIOUS = "verdict", "previous verdict"


def step_values(
    row: Row, latency_ms: float, number: int, changes: Changes | None = None
) -> dict[str, object]:
    """Values of a status on ``slam/steps``: all numbers as JSON in one of them.

    A message of forty values costs both ends ten times as much as one of a line does.

    Parameters
    ----------
    row : Row
        The step's numbers by column.
    latency_ms : float
        From receiving the features until their pose goes out, milliseconds.
    number : int
        How many steps the node has published, this one included.
    changes : mapping, optional
        Parameters that hold from this step on.
    """
    numbers = {**row, _LATENCY: latency_ms, _NUMBER: number}
    return {_ROW: json.dumps(numbers, default=float), **change_values(changes or {})}


def row_from_values(values: Mapping[str, str]) -> tuple[Row, float, int]:
    """Inverse of :func:`step_values`, but for the changes.

    Raises
    ------
    RefusedMessage
        ``bad_fields``, where a value is missing or is no number.
    """
    try:
        told = json.loads(values[_ROW])
        if missing := KINDS.keys() - told.keys():
            raise RefusedMessage(
                Refusal.BAD_FIELDS, f"slam/steps: without {', '.join(sorted(missing))}"
            )
        row = {name: KINDS.get(name, float)(value) for name, value in told.items()}
        return row, row.pop(_LATENCY), int(row.pop(_NUMBER))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise RefusedMessage(Refusal.BAD_FIELDS, f"slam/steps: {error!r}") from error


def verdict_values(judgement: Judgement, which: str = PRESENT) -> dict[str, object]:
    """Values of a verdict on /diagnostics."""
    reasons = {
        f"{which} reason {number}": reason
        for number, reason in enumerate(judgement.reasons, start=1)
    }
    return {which: judgement.word.value, f"{which} at [ns]": judgement.stamp, **reasons}


def verdict_from_values(values: Mapping[str, str], which: str = PRESENT) -> Judgement | None:
    """Inverse of :func:`verdict_values`; None where there is none.

    Raises
    ------
    RefusedMessage
        ``bad_fields``, where there is another word or no stamp.
    """
    if which not in values:
        return None
    try:
        word, stamp = Word(values[which]), int(values[f"{which} at [ns]"])
    except (KeyError, ValueError) as error:
        raise RefusedMessage(Refusal.BAD_FIELDS, f"{which}: {error}") from error
    numbers = itertools.takewhile(
        lambda number: f"{which} reason {number}" in values, itertools.count(1)
    )
    return Judgement(stamp, word, tuple(values[f"{which} reason {n}"] for n in numbers))


def process_from_values(values: Mapping[str, str]) -> tuple[float, int]:
    """Peak memory (MB) and resets of slam_node, of its status.

    Raises
    ------
    RefusedMessage
        ``bad_fields``, where one is missing or is no number.
    """
    try:
        return float(values[_PEAK_MEMORY]), int(values[_RESETS])
    except (KeyError, ValueError) as error:
        raise RefusedMessage(Refusal.BAD_FIELDS, f"slam_node's status: {error!r}") from error


class SlamReport:
    """Gathers steps for /diagnostics."""

    def __init__(self, node: Node, core: "Slam"):
        self._node = node
        self._core = core
        self._total = 0
        self._frozen = self._left_out = 0
        self._recent = StepTotals()
        self._last: SlamStep | None = None
        self._warned = False

    @property
    def steps(self) -> int:
        """How many steps were noted."""
        return self._total

    def add(self, step: SlamStep, row: Row) -> None:
        """Note a step and its numbers by column."""
        self._total += 1
        self._frozen += step.frozen
        self._left_out += step.left_out
        self._recent.add(row)
        self._last = step

    def values(self) -> dict[str, object]:
        """Values since the last call and in all."""
        recent, self._recent = self._recent, StepTotals()
        values: dict[str, object] = {
            "steps": self._total,
            "frozen steps": self._frozen,
            _RESETS: self._core.resets,
            "features waiting": len(self._core.waiting),
            "left out": self._left_out,
        }
        values.update(values_if_over(self._core.refused_if_over))
        if self._last is not None:
            values["stamp age [s]"] = stamp_age(self._node, self._last.stamp)
            values["active landmarks"] = self._last.active
            values["total landmarks"] = self._last.landmarks
            for estimate in self._last.estimates:
                labels = [column.label for column in estimate.quantity.columns]
                values.update(zip(labels, estimate.numbers().values(), strict=True))
        if recent.steps:
            values["rejected [%]"] = 100.0 * (recent.rejected_fraction or 0.0)
            values["NIS per degree of freedom"] = recent.nis_per_dof or 0.0
            values["step mean [ms]"] = sum(recent.ms) / recent.steps
            values["step max [ms]"] = max(recent.ms)
        values[_PEAK_MEMORY] = peak_rss_mb() or 0.0
        for which, judgement in (
            (PREVIOUS, self._core.previous_verdict),
            (PRESENT, self._core.verdict()),
        ):
            if judgement is not None:
                values.update(verdict_values(judgement, which))
        return values

    def warning(self) -> str | None:
        """What is wrong at present, or was since the values were told last."""
        left_out = self._recent.left_out
        crowd = f"{left_out} observations left out by max_active" if left_out else None
        return "; ".join(filter(None, (crowd, self._contradiction()))) or None

    def _contradiction(self) -> str | None:
        """What the verdict says at present, logged when it begins and when it ends."""
        judgement = self._core.present_verdict()
        if judgement is None or judgement.word is Word.GOOD:
            if self._warned:
                self._node.get_logger().info("all is well again")
            self._warned = False
            return None
        warning = f"{judgement.word.value}: {judgement.reasons[0]}"
        if not self._warned:
            self._node.get_logger().warning(warning)
        self._warned = True
        return warning
