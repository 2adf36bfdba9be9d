# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node says of its steps: each on ``slam/steps``, all since the last on /diagnostics."""

from collections.abc import Mapping
from typing import Any

from rclpy.node import Node

from vislam_ros.core.slam import Slam, SlamStep
from vislam_ros.data.results.summary import StepStatistics, peak_rss_mb
from vislam_ros.data.results.writer import STEP_COLUMNS
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.nodes.diagnostics import stamp_age


def step_values(step: SlamStep, latency_ms: float) -> dict[str, object]:
    """Values of a status on ``slam/steps``.

    Parameters
    ----------
    step : SlamStep
    latency_ms : float
        From receiving the features to publishing their pose, milliseconds.
    """
    values: dict[str, object] = {
        "stamp": step.stamp,
        "frozen": step.frozen,
        "active": step.active,
        "used": step.used,
        "rejected": step.rejected,
        "observed": step.observed,
        "admitted": step.admitted,
        "landmarks": step.landmarks,
        "nis": step.nis,
        "nis_dof": step.nis_dof,
        "ms": step.duration_ms,
        "tracks": step.tracks,
        "first_of_pass": step.first_of_pass,
        "latency_ms": latency_ms,
    }
    values.update(_gyro_bias_values(step, "gyro_bias_{}", "gyro_bias_std_{}"))
    return values


def _gyro_bias_values(step: SlamStep, name: str, std_name: str) -> dict[str, object]:
    """Bias of the gyroscope and its standard deviation by axis; nothing where there is none."""
    if step.gyro_bias is None or step.gyro_bias_std is None:
        return {}
    return {
        style.format(axis): float(value)
        for style, vector in ((name, step.gyro_bias), (std_name, step.gyro_bias_std))
        for axis, value in zip("xyz", vector, strict=True)
    }


def statistics_from_values(stamp: int, values: Mapping[str, str]) -> StepStatistics:
    """Statistics of a step from the values of its status; ``stamp`` in nanoseconds.

    Raises
    ------
    KeyError, ValueError
        Where a value is missing or is no number.
    """
    numbers: dict[str, Any] = {
        name: float(values[name]) if name in ("nis", "ms") else int(values[name])
        for name in STEP_COLUMNS[2:]
    }
    return StepStatistics(stamp=stamp, frozen=values["frozen"] == "true", **numbers)


def gyro_bias_from_values(values: Mapping[str, str]) -> list[float] | None:
    """Bias of the gyroscope (3,), radians a second, from the values of a step's status.

    Raises
    ------
    ValueError
        Where a value is no number.
    """
    names = [f"gyro_bias_{axis}" for axis in "xyz"]
    return [float(values[name]) for name in names] if names[0] in values else None


class SlamReport:
    """Gathers steps for /diagnostics."""

    def __init__(self, node: Node, core: Slam):
        self._node = node
        self._core = core
        self._total = 0
        self._frozen = 0
        self._recent: list[SlamStep] = []
        self._last: SlamStep | None = None

    def add(self, step: SlamStep) -> None:
        """Note a step."""
        self._total += 1
        self._frozen += step.frozen
        self._recent.append(step)
        self._last = step

    def values(self) -> dict[str, object]:
        """Values since the last call and in all."""
        recent, self._recent = self._recent, []
        values: dict[str, object] = {
            "steps": self._total,
            "frozen steps": self._frozen,
            "resets": self._core.resets,
            "features waiting": len(self._core.waiting),
        }
        if self._core.waiting:
            values["first waiting [s]"] = stamp_text(self._core.waiting[0])
            values["waiting would be"] = self._core.waits_for.word
        if self._last is not None:
            values["stamp age [s]"] = stamp_age(self._node, self._last.stamp)
            values["active landmarks"] = self._last.active
            values["total landmarks"] = self._last.landmarks
            values.update(
                _gyro_bias_values(self._last, "gyro bias {} [rad/s]", "gyro bias sigma {} [rad/s]")
            )
        if recent:
            rejected = sum(step.rejected for step in recent)
            gated = rejected + sum(step.used for step in recent)
            dof = sum(step.nis_dof for step in recent)
            durations = [step.duration_ms for step in recent]
            values["rejected [%]"] = 100.0 * rejected / gated if gated else 0.0
            values["NIS per degree of freedom"] = (
                sum(step.nis for step in recent) / dof if dof else 0.0
            )
            values["step mean [ms]"] = sum(durations) / len(durations)
            values["step max [ms]"] = max(durations)
        values["peak memory [MB]"] = peak_rss_mb() or 0.0
        return values
