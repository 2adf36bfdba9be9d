# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The runs of a sweep, gathered point by point."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vislam_ros.data.sweeps.plan import Point, SweepRun
from vislam_ros.data.sweeps.run import Row

#: Columns of which each point has the mean over its seeds and, after it, the spread.
FIGURES = (
    "ate_m",
    "nees_per_dof",
    "smoothed_ate_m",
    "smoothed_nees_per_dof",
    "rpe_frame_m",
    "dead_reckoning_ate_m",
    "nis_per_dof",
    "rejected_fraction",
    "frozen_steps",
    "landmarks",
    "step_ms_p50",
    "wall_s",
)


@dataclass(frozen=True)
class PointResult:
    """What the runs at one point of the grid gave.

    Attributes
    ----------
    point : dict
        Values of the swept settings.
    rows : tuple of Row
        Of the runs that ended well, in the order of the seeds.
    errors : tuple of str
        Of those that failed.
    """

    point: Point
    rows: tuple[Row, ...]
    errors: tuple[str, ...]

    def values(self, figure: str) -> list[float]:
        """Return what the runs gave for a figure, without those that do not know it."""
        return [row[figure] for row in self.rows if row.get(figure) is not None]

    def mean(self, figure: str) -> float | None:
        """Return the mean over the runs; None where none knows it."""
        values = self.values(figure)
        return float(np.mean(values)) if values else None


def gather(runs: Sequence[SweepRun], rows: Mapping[str, Row]) -> list[PointResult]:
    """Sort the rows of finished runs to their points, in the order of the runs."""
    points: dict[str, tuple[Point, list[Row]]] = {}
    for run in runs:
        _, found = points.setdefault(repr(run.point), (run.point, []))
        if run.key in rows:
            found.append(rows[run.key])
    return [
        PointResult(
            point,
            tuple(row for row in found if row["error"] is None),
            tuple(row["error"] for row in found if row["error"] is not None),
        )
        for point, found in points.values()
    ]


def known_figures(points: Sequence[PointResult]) -> list[str]:
    """Names of the figures that any run knows."""
    return [name for name in FIGURES if any(point.values(name) for point in points)]


def value_text(value: Any) -> str:
    """Value of a setting as a person writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(value_text, value))}]"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def table_csv(points: Sequence[PointResult]) -> str:
    """Return a line for each point: settings, runs, failures, and mean and spread of figures."""
    settings = list(points[0].point) if points else []
    figures = known_figures(points)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    spread = [f"{name}_{part}" for name in figures for part in ("mean", "std", "min", "max")]
    writer.writerow([*settings, "runs", "failed", *spread, "error"])
    for point in points:
        cells: list[Any] = [value_text(point.point[name]) for name in settings]
        cells += [len(point.rows) + len(point.errors), len(point.errors)]
        for name in figures:
            values = point.values(name)
            if values:
                cells += [np.mean(values), np.std(values), min(values), max(values)]
            else:
                cells += [""] * 4
        writer.writerow([*cells, point.errors[0] if point.errors else ""])
    return text.getvalue()
