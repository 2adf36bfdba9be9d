# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows of trials, summed up for each value of each constant."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmark.consistency.simulated_drives import std_error
from benchmark.sensitivity.constants import Constant, Value
from benchmark.sensitivity.drives import TrialDrive
from benchmark.sensitivity.trials import Trial
from vislam_ros.data.sweeps.run import Row

GROUPS = ("simulated", "recorded")
_MEANS = ("error_percent", "ate_m", "nees", "landmarks", "outside_percent")

# Columns of the table for each group: key, heading, format.
_COLUMNS = (
    ("changed", "changed", "{} of {}"),
    ("error_percent", "error [%]", "{:.2f}"),
    ("ate_ratio", "ATE, to as is", "{:.3f} ± {:.3f}"),
    ("nees", "NEES/6", "{:.2f}"),
    ("outside_percent", "map outside 99 % [%]", "{:.1f}"),
)


def summary(
    constants: Sequence[Constant], drives: Sequence[TrialDrive], rows: Mapping[str, Row]
) -> list[dict[str, Any]]:
    """Sum up: first all as it stands, then each value of each constant.

    Returns
    -------
    list of dict
        ``constant`` and ``value`` (None as it stands), ``failed`` with the errors of trials, and
        for each group of drives the means of the figures, the number of ``drives``, how many
        trajectories ``changed`` by a bit at least, and the geometric mean ``ate_ratio`` of the
        ATE to that as it stands, with its ``ate_ratio_std_error`` in the logarithm.
    """
    results = [_summed(None, None, drives, rows)]
    for constant in constants:
        results += [_summed(constant, value, drives, rows) for value in constant.values]
    return results


def _summed(
    constant: Constant | None,
    value: Value | None,
    drives: Sequence[TrialDrive],
    rows: Mapping[str, Row],
) -> dict[str, Any]:
    pairs = [(rows.get(Trial(d, constant, value).key), rows.get(Trial(d).key)) for d in drives]
    result: dict[str, Any] = {
        "constant": constant.key if constant else None,
        "value": value,
        "failed": [row["error"] for row, _ in pairs if row and row["error"]],
    }
    for group in GROUPS:
        good = [
            (row, as_is)
            for drive, (row, as_is) in zip(drives, pairs, strict=True)
            if drive.group == group and row and as_is and not row["error"] and not as_is["error"]
        ]
        if good:
            result[group] = _figures(good)
    return result


def _figures(pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    figures: dict[str, Any] = {name: _mean(row.get(name) for row, _ in pairs) for name in _MEANS}
    logs = np.log([row["ate_m"] / as_is["ate_m"] for row, as_is in pairs])
    figures["drives"] = len(pairs)
    figures["changed"] = sum(row["sha256"] != as_is["sha256"] for row, as_is in pairs)
    figures["ate_ratio"] = math.exp(float(np.mean(logs)))
    figures["ate_ratio_std_error"] = std_error(logs)
    return figures


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def markdown(results: Sequence[Mapping[str, Any]]) -> str:
    """Table of a summary."""
    groups = [group for group in GROUPS if group in results[0]]
    headings = ["constant", "value"]
    for group in groups:
        shown = [heading for key, heading, _ in _COLUMNS if results[0][group].get(key) is not None]
        headings += [f"{group}: {shown[0]}", *shown[1:]]
    lines = [_line(headings), _line(["---"] * len(headings))]
    for result in results:
        cells = [f"`{result['constant']}`" if result["constant"] else "as is", _text(result)]
        for group in groups:
            cells += _cells(result.get(group, {}), results[0][group])
        lines.append(_line(cells))
    return "\n".join(lines) + "\n"


def _text(result: Mapping[str, Any]) -> str:
    value = result["value"]
    if value is None:
        return ""
    if isinstance(value, tuple | list):
        return ", ".join(f"{number:g}" for number in dict.fromkeys(value))
    return f"{value:g}"


def _cells(figures: Mapping[str, Any], as_is: Mapping[str, Any]) -> list[str]:
    cells = []
    for key, _, form in _COLUMNS:
        if as_is.get(key) is None:
            continue
        value = figures.get(key)
        if value is None:
            cells.append("failed")
        elif key == "changed":
            cells.append(form.format(value, figures["drives"]))
        elif key == "ate_ratio":
            cells.append(form.format(value, figures["ate_ratio_std_error"] or 0.0))
        else:
            cells.append(form.format(value))
    return cells


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
