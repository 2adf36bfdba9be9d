# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of the battery, summed up row by row and group by group."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmark.battery.rows import BatteryRow
from benchmark.battery.trials import Trial
from vislam_ros.data.sweeps.run import Row

#: The group that holds all rows.
ALL = "all"

# Above this much of dead reckoning's error, and so many metres on top of it, an estimate is worse.
_WORSE_FACTOR, _WORSE_METRES = 1.05, 0.02

_MEANS = (
    "dead_reckoning_percent",
    "dead_reckoning_m",
    "estimate_percent",
    "estimate_m",
    "smoothed_percent",
    "smoothed_m",
    "estimate_ate_m",
    "smoothed_ate_m",
    "estimate_nees",
    "smoothed_nees",
)
# Ratios of errors that a row has, and of which a group has the geometric mean.
_RATIOS = (
    "to_dead_reckoning",
    "smoothed_to_dead_reckoning",
    "to_beside",
    "smoothed_to_beside",
)


def is_worse(estimate_m: float, dead_reckoning_m: float) -> bool:
    """Whether mean errors say that the estimate did more harm than good."""
    return estimate_m > _WORSE_FACTOR * dead_reckoning_m + _WORSE_METRES


def summed_rows(
    rows: Sequence[BatteryRow],
    trials: Sequence[Trial],
    found: Mapping[str, Row],
    beside: Mapping[str, Row] | None = None,
) -> list[dict[str, Any]]:
    """Sum up each row of the battery, group by group.

    Parameters
    ----------
    rows : sequence of BatteryRow
    trials : sequence of Trial
        Of these rows.
    found : mapping of str to Row
        What trials gave, by their keys.
    beside : mapping of str to Row, optional
        What they gave at another time.

    Returns
    -------
    list of dict
        ``name`` and ``group``; the number of ``seeds`` that ended well and of those that
        ``failed``; means over the seeds of the errors in per cent of the path and in metres, of
        the ATE and of the NEES/6; the largest component of the gyroscope's bias,
        ``gyro_bias_max``, at the end of any seed; ``to_dead_reckoning``, the ratio of the
        estimate's error to that of dead reckoning; and whether it is ``worse``. With others
        beside, their mean error ``beside_percent`` and the ratio ``to_beside`` over the seeds
        that both have.
    """
    summed = [
        _summed(row, [trial for trial in trials if trial.row == row], found, beside or {})
        for row in rows
    ]
    groups = list(dict.fromkeys(row.group for row in rows))
    return sorted(summed, key=lambda row: groups.index(row["group"]))


def summed_groups(summed: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Sum up each group, and all: counts, and geometric means of ratios of errors."""
    groups = dict.fromkeys(row["group"] for row in summed)
    results = [_group(name, [row for row in summed if row["group"] == name]) for name in groups]
    return [*results, _group(ALL, summed)]


def failures(trials: Sequence[Trial], found: Mapping[str, Row]) -> list[str]:
    """Name the trials that failed, and why."""
    rows = [found[trial.key] for trial in trials if trial.key in found]
    return [f"{row['key']}: {row['error']}" for row in rows if row["error"]]


def _summed(
    row: BatteryRow,
    trials: Sequence[Trial],
    found: Mapping[str, Row],
    beside: Mapping[str, Row],
) -> dict[str, Any]:
    good = _good(trials, found)
    result: dict[str, Any] = {
        "name": row.name,
        "group": row.group,
        "seeds": len(good),
        "failed": sum(trial.key in found for trial in trials) - len(good),
    }
    result |= {figure: _mean(good.values(), figure) for figure in _MEANS}
    axes = [trial.get(f"gyro_bias_{axis}") for trial in good.values() for axis in "xyz"]
    result["gyro_bias_max"] = max((abs(bias) for bias in axes if bias is not None), default=None)
    for name, ratio in (("estimate", "to"), ("smoothed", "smoothed_to")):
        result[f"{ratio}_dead_reckoning"] = _ratio(
            result[f"{name}_percent"], result["dead_reckoning_percent"]
        )
    known = good and None not in (result["estimate_m"], result["dead_reckoning_m"])
    result["worse"] = is_worse(result["estimate_m"], result["dead_reckoning_m"]) if known else None
    return result | _beside(good, _good(trials, beside))


def _beside(good: Mapping[str, Row], others: Mapping[str, Row]) -> dict[str, Any]:
    both = good.keys() & others.keys()
    ours, theirs = ([rows[key] for key in sorted(both)] for rows in (good, others))
    estimate, smoothed = (
        (_mean(ours, figure), _mean(theirs, figure))
        for figure in ("estimate_percent", "smoothed_percent")
    )
    return {
        "beside_percent": estimate[1],
        "to_beside": _ratio(*estimate),
        "smoothed_beside_percent": smoothed[1],
        "smoothed_to_beside": _ratio(*smoothed),
    }


def _group(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {
        "name": name,
        "rows": len(rows),
        "failed": sum(row["failed"] for row in rows),
        "worse": sum(bool(row["worse"]) for row in rows),
    }
    return result | {ratio: _geometric_mean(row[ratio] for row in rows) for ratio in _RATIOS}


def _good(trials: Sequence[Trial], found: Mapping[str, Row]) -> dict[str, Row]:
    rows = {trial.key: found[trial.key] for trial in trials if trial.key in found}
    return {key: row for key, row in rows.items() if not row["error"]}


def _mean(rows: Iterable[Row], figure: str) -> float | None:
    known = [row[figure] for row in rows if row.get(figure) is not None]
    return float(np.mean(known)) if known else None


def _ratio(error: float | None, other: float | None) -> float | None:
    return error / other if error is not None and other else None


def _geometric_mean(ratios: Iterable[float | None]) -> float | None:
    logs = [math.log(ratio) for ratio in ratios if ratio]
    return math.exp(float(np.mean(logs))) if logs else None
