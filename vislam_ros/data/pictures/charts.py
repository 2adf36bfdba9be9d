# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is worth a look over time, as numbers: for whatever draws them, a page or a viewer."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.evaluation.consistency import chi_square_band, nees_bounds
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.errors import AXES, axis_errors
from vislam_ros.data.pictures.estimates import quantities_of, settled_range
from vislam_ros.data.pictures.overview import map_covariances
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

_COLOURS = (palette.ESTIMATE, palette.SMOOTHED, palette.START)
_THREE_SIGMA = f"± 3 {palette.SIGMA}"


@dataclass(frozen=True)
class Line:
    """Values (n,) over the seconds (n,) from the first pose."""

    name: str
    seconds: Array
    values: Array
    colour: str


@dataclass(frozen=True)
class Band:
    """What lies between two lines over the same seconds, each (n,)."""

    seconds: Array
    low: Array
    high: Array
    colour: str


@dataclass
class Chart:
    """Lines and bands that belong together.

    Attributes
    ----------
    key : str
        A word for it, among those of all charts.
    title : str
    lines : list of Line
    bands : list of Band
    limits : tuple of float or None
        Of the values to show; None for all, and None for an end that is free.
    logarithmic : bool
    """

    key: str
    title: str
    lines: list[Line] = field(default_factory=list)
    bands: list[Band] = field(default_factory=list)
    limits: tuple[float | None, float | None] = (None, None)
    logarithmic: bool = False


def charts_of(results: Results, reference: Trajectory | None = None) -> list[Chart]:
    """All charts that a result has something for, the most telling first."""
    charts = [*_of_steps(results), *_deviations(results)]
    if reference is not None:
        charts += _errors(results, reference)
    return [*charts, *_estimates(results)]


def _seconds(results: Results) -> Array:
    return (results.steps["stamp"] - results.trajectory.stamps[0]) * 1e-9


def _of_steps(results: Results) -> Iterator[Chart]:
    steps, seconds = results.steps, _seconds(results)
    if not len(seconds):
        return
    # A frozen frame uses none, which says nothing of the others.
    used = np.where(steps["frozen"], np.nan, steps["used"])
    yield Chart(
        "landmarks",
        "landmarks",
        [
            Line(name, seconds, values, colour)
            for name, values, colour in (
                ("observed", steps["observed"], palette.OBSERVED),
                ("active", steps["active"], palette.SMOOTHED),
                ("used", used, palette.ESTIMATE),
                ("rejected", steps["rejected"], palette.END),
            )
        ],
        limits=(0.0, None),
    )
    measured = steps["nis_dof"] > 0
    if measured.any():
        dof, when = steps["nis_dof"][measured], seconds[measured]
        each = steps["nis"][measured] / dof
        yield Chart(
            "nis",
            "NIS / dof with its 95 % band",
            [Line("each step", when, each, palette.ESTIMATE)],
            [Band(when, *chi_square_band(dof), palette.START)],
            (0.0, max(2.0, 1.2 * float(np.percentile(each, 99)))),
        )
    yield Chart(
        "step_ms",
        "time a step [ms]",
        [Line("step", seconds, steps["ms"], palette.ESTIMATE)],
        limits=(0.0, max(2.0 * float(np.percentile(steps["ms"], 99)), 1e-3)),
    )


def _deviations(results: Results) -> Iterator[Chart]:
    variances = np.diagonal(map_covariances(results), axis1=1, axis2=2)
    if not np.isfinite(variances).any():
        return
    seconds = (results.trajectory.stamps - results.trajectory.stamps[0]) * 1e-9
    columns = zip("xyz", np.sqrt(np.maximum(variances, 0.0)).T, _COLOURS, strict=True)
    yield Chart(
        "position_std",
        f"{palette.SIGMA} of the position in the map [m]",
        [Line(axis, seconds, column, colour) for axis, column, colour in columns],
        limits=(0.0, None),
    )


def _errors(results: Results, reference: Trajectory) -> Iterator[Chart]:
    seconds, errors, std, nees = axis_errors(results, reference)
    for name, error, sigma in zip(AXES, errors.T, std.T, strict=True):
        yield Chart(
            f"error_{name.split()[0]}",
            f"error {name}, {_THREE_SIGMA}",
            [Line("error", seconds, error, palette.ESTIMATE)],
            [Band(seconds, -3 * sigma, 3 * sigma, palette.ESTIMATE)],
        )
    if np.isfinite(nees).any():
        low, high = (bound * np.ones(len(seconds)) for bound in nees_bounds())
        yield Chart(
            "nees",
            "NEES / 6 with its 95 % band",
            [Line("NEES", seconds, nees, palette.ESTIMATE)],
            [Band(seconds, low, high, palette.START)],
            logarithmic=True,
        )


def _estimates(results: Results) -> Iterator[Chart]:
    steps, seconds = results.steps, _seconds(results)
    if not len(seconds):
        return
    for quantity in quantities_of(steps):
        chart = Chart(quantity.name, quantity.label + (f", {_THREE_SIGMA}" * quantity.has_std))
        for k, name in enumerate(quantity.names):
            value, colour = steps[name], _COLOURS[k]
            if quantity.std_names:
                spread = 3.0 * steps[quantity.std_names[k]]
                chart.bands.append(Band(seconds, value - spread, value + spread, colour))
            label = quantity.axes[k] if quantity.axes else quantity.name
            chart.lines.append(Line(label, seconds, value, colour))
        chart.limits = settled_range(steps, quantity) or chart.limits
        yield chart
