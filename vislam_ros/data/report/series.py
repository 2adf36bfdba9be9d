# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What happened over time, one chart below the other with one axis, as plotly's JSON has it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from vislam_ros.data.pictures.charts import Band, Chart, Line, charts_of
from vislam_ros.data.report.scene import MOST_POSES, evenly
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

_GRID = {"gridcolor": "#e6e6e6", "zerolinecolor": "#cccccc"}
_ROW_PIXELS, _GAP_PIXELS, _FOOT_PIXELS = 120, 34, 40


def series_figure(results: Results, reference: Trajectory | None = None) -> dict[str, Any]:
    """Data and layout of the charts; their height in pixels stands in the layout."""
    return _stacked(charts_of(results, reference))


def _traces(chart: Chart) -> Iterator[dict[str, Any]]:
    """Bands first, so that the lines lie on them."""
    yield from map(_band, chart.bands)
    yield from map(_line, chart.lines)


def _line(line: Line) -> dict[str, Any]:
    rows = evenly(len(line.seconds), MOST_POSES)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": line.name,
        "x": line.seconds[rows].astype(np.float32),
        "y": np.asarray(line.values)[rows].astype(np.float32),
        "line": {"color": line.colour, "width": 1},
        "hovertemplate": "%{y:.4g}",
    }


def _band(band: Band) -> dict[str, Any]:
    rows = evenly(len(band.seconds), MOST_POSES)
    rows = rows[np.isfinite(band.low[rows]) & np.isfinite(band.high[rows])]
    there_and_back = np.concatenate([rows, rows[::-1]])
    edge = np.concatenate([band.low[rows], band.high[rows[::-1]]])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": band.seconds[there_and_back].astype(np.float32),
        "y": edge.astype(np.float32),
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": band.colour,
        "opacity": 0.18,
        "hoverinfo": "skip",
    }


def _axis(chart: Chart) -> dict[str, Any]:
    low, high = chart.limits
    if chart.logarithmic:
        return {"type": "log"}
    if low is None and high is None:
        return {}
    return {"range": [low, high]}


def _stacked(charts: Sequence[Chart]) -> dict[str, Any]:
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
            **_axis(chart),
        }
        traces += [{**each, "xaxis": "x", "yaxis": f"y{number}"} for each in _traces(chart)]
        named = chart.lines if len(chart.lines) > 1 else []
        words = "  ".join(
            f'<span style="color:{line.colour}">{line.name}</span>' for line in named
        )
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
