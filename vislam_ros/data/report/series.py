# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What happened over time, one chart below the other with one axis, as plotly's JSON has it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.evaluation.consistency import chi_square_band, nees_bounds
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.errors import AXES, axis_errors
from vislam_ros.data.pictures.estimates import quantities_of
from vislam_ros.data.pictures.overview import map_covariances
from vislam_ros.data.report.scene import MOST_POSES, evenly
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

_COLOURS = (palette.ESTIMATE, palette.SMOOTHED, palette.START)
_GRID = {"gridcolor": "#e6e6e6", "zerolinecolor": "#cccccc"}
_ROW_PIXELS, _GAP_PIXELS, _FOOT_PIXELS = 120, 34, 40


@dataclass
class _Chart:
    """One row: its title, and its lines with their colours and bands."""

    title: str
    lines: list[dict[str, Any]] = field(default_factory=list)
    axis: dict[str, Any] = field(default_factory=dict)
    names: list[tuple[str, str]] = field(default_factory=list)

    def add(self, name: str, seconds: Array, values: Array, colour: str, **changes: Any) -> None:
        rows = evenly(len(seconds), MOST_POSES)
        self.lines.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": name,
                "x": seconds[rows].astype(np.float32),
                "y": np.asarray(values)[rows].astype(np.float32),
                "line": {"color": colour, "width": 1},
                "hovertemplate": "%{y:.4g}",
                **changes,
            }
        )
        self.names.append((name, colour))

    def add_band(self, seconds: Array, low: Array, high: Array, colour: str) -> None:
        """Fill between two lines."""
        rows = evenly(len(seconds), MOST_POSES)
        rows = rows[np.isfinite(low[rows]) & np.isfinite(high[rows])]
        there_and_back = np.concatenate([rows, rows[::-1]])
        edge = np.concatenate([low[rows], high[rows[::-1]]])
        self.lines.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": seconds[there_and_back].astype(np.float32),
                "y": edge.astype(np.float32),
                "line": {"width": 0},
                "fill": "toself",
                "fillcolor": colour,
                "opacity": 0.18,
                "hoverinfo": "skip",
            }
        )


def series_figure(results: Results, reference: Trajectory | None = None) -> dict[str, Any]:
    """Data and layout of the charts; its height in pixels stands in the layout."""
    charts = [*_step_charts(results), _deviations(results)]
    if reference is not None:
        charts += _error_charts(results, reference)
    charts += _estimate_charts(results)
    return _stacked([chart for chart in charts if chart.lines])


def _step_charts(results: Results) -> list[_Chart]:
    steps = results.steps
    if not len(steps["stamp"]):
        return []
    seconds = (steps["stamp"] - results.trajectory.stamps[0]) * 1e-9
    landmarks = _Chart("landmarks", axis={"rangemode": "tozero"})
    for name, colour in (
        ("observed", palette.OBSERVED),
        ("active", palette.SMOOTHED),
        ("used", palette.ESTIMATE),
        ("rejected", palette.END),
    ):
        landmarks.add(name, seconds, steps[name], colour)
    consistency = _Chart("NIS / dof with its 95 % band")
    measured = steps["nis_dof"] > 0
    if measured.any():
        dof, when = steps["nis_dof"][measured], seconds[measured]
        consistency.add_band(when, *chi_square_band(dof), palette.START)
        each = steps["nis"][measured] / dof
        consistency.add("each step", when, each, palette.ESTIMATE)
        top = max(2.0, 1.2 * float(np.percentile(each, 99)))
        consistency.axis["range"] = [0.0, top]
    duration = _Chart("time a step [ms]")
    duration.add("step", seconds, steps["ms"], palette.ESTIMATE)
    duration.axis["range"] = [0.0, max(2.0 * float(np.percentile(steps["ms"], 99)), 1e-3)]
    return [landmarks, consistency, duration]


def _deviations(results: Results) -> _Chart:
    chart = _Chart(f"{palette.SIGMA} of the position in the map [m]", axis={"rangemode": "tozero"})
    variances = np.diagonal(map_covariances(results), axis1=1, axis2=2)
    if np.isfinite(variances).any():
        seconds = (results.trajectory.stamps - results.trajectory.stamps[0]) * 1e-9
        std = np.sqrt(np.maximum(variances, 0.0))
        for axis, column, colour in zip("xyz", std.T, _COLOURS, strict=True):
            chart.add(axis, seconds, column, colour)
    return chart


def _error_charts(results: Results, reference: Trajectory) -> list[_Chart]:
    seconds, errors, std, nees = axis_errors(results, reference)
    charts = []
    for name, error, sigma in zip(AXES, errors.T, std.T, strict=True):
        chart = _Chart(f"error {name}, ± 3 {palette.SIGMA}")
        chart.add_band(seconds, -3 * sigma, 3 * sigma, palette.ESTIMATE)
        chart.add("error", seconds, error, palette.ESTIMATE)
        charts.append(chart)
    consistency = _Chart("NEES / 6 with its 95 % band", axis={"type": "log"})
    if np.isfinite(nees).any():
        low, high = nees_bounds()
        ones = np.ones(len(seconds))
        consistency.add_band(seconds, low * ones, high * ones, palette.START)
        consistency.add("NEES", seconds, nees, palette.ESTIMATE)
    return [*charts, consistency]


def _estimate_charts(results: Results) -> list[_Chart]:
    steps = results.steps
    if not len(steps["stamp"]):
        return []
    seconds = (steps["stamp"] - results.trajectory.stamps[0]) * 1e-9
    charts = []
    for quantity in quantities_of(steps):
        chart = _Chart(quantity.label + (f", ± 3 {palette.SIGMA}" if quantity.has_std else ""))
        ends = []
        for k, name in enumerate(quantity.names):
            value = steps[name]
            spread = 3.0 * steps[quantity.std_names[k]] if quantity.std_names else 0.0 * value
            if quantity.std_names:
                chart.add_band(seconds, value - spread, value + spread, _COLOURS[k])
            label = quantity.axes[k] if quantity.axes else quantity.name
            chart.add(label, seconds, value, _COLOURS[k])
            # As in the pictures: the prior's band would flatten all that comes after it.
            settled = slice(len(value) // 20, None)
            ends += [(value - spread)[settled], (value + spread)[settled]]
        values = np.concatenate(ends)
        values = values[np.isfinite(values)]
        if len(values) and np.ptp(values) > 0.0:
            low, high = float(values.min()), float(values.max())
            chart.axis["range"] = [low - 0.08 * (high - low), high + 0.08 * (high - low)]
        charts.append(chart)
    return charts


def _stacked(charts: Sequence[_Chart]) -> dict[str, Any]:
    """All charts in one figure, from the top down, with one axis of time."""
    height = len(charts) * (_ROW_PIXELS + _GAP_PIXELS) + _FOOT_PIXELS
    traces: list[dict[str, Any]] = []
    last = "" if len(charts) < 2 else str(len(charts))
    layout: dict[str, Any] = {
        "height": height,
        "showlegend": False,
        "plot_bgcolor": "#ffffff",
        "hovermode": "x",
        "hoversubplots": "axis",
        "margin": {"l": 52, "r": 12, "t": 0, "b": _FOOT_PIXELS},
        "annotations": [],
        "uirevision": "kept",
        "xaxis": {
            "title": {"text": "time [s]"},
            "anchor": f"y{last}",
            "showspikes": True,
            "spikemode": "across",
            "spikethickness": 1,
            "spikedash": "solid",
            **_GRID,
        },
    }
    plot_height = height - _FOOT_PIXELS
    for k, chart in enumerate(charts):
        number = "" if k == 0 else str(k + 1)
        top = 1.0 - (k * (_ROW_PIXELS + _GAP_PIXELS) + _GAP_PIXELS) / plot_height
        domain = [max(top - _ROW_PIXELS / plot_height, 0.0), top]
        layout[f"yaxis{number}"] = {
            "domain": domain,
            "anchor": "x",
            "nticks": 5,
            **_GRID,
            **chart.axis,
        }
        traces += [{**line, "xaxis": "x", "yaxis": f"y{number}"} for line in chart.lines]
        names = chart.names if len(chart.names) > 1 else []
        words = "  ".join(f'<span style="color:{colour}">{name}</span>' for name, colour in names)
        layout["annotations"].append(
            {
                "text": f"<b>{chart.title}</b>  {words}",
                "x": 0.0,
                "y": top,
                "xref": "paper",
                "yref": "paper",
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 12},
            }
        )
    return {"data": traces, "layout": layout}
