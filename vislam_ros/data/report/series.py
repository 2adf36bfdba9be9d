# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What happened over time, a figure for each chart, as plotly's JSON has it."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from vislam_ros.data.pictures.charts import Band, Chart, Line, charts_of
from vislam_ros.data.report.scene import MOST_POSES, evenly
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

_GRID = {"gridcolor": "#e6e6e6", "zerolinecolor": "#cccccc"}
_PLOT_PIXELS, _HEAD_PIXELS, _FOOT_PIXELS, _LAST_FOOT_PIXELS = 120, 24, 26, 40


def series_figures(results: Results, reference: Trajectory | None = None) -> list[dict[str, Any]]:
    """Data and layout of each chart, from the top down; its height in pixels is in the layout."""
    charts = charts_of(results, reference)
    return [_figure(chart, is_last=chart is charts[-1]) for chart in charts]


def _traces(chart: Chart) -> Iterator[dict[str, Any]]:
    """Bands first, so that the lines lie on them."""
    yield from map(_band, chart.bands)
    for line in chart.lines:
        yield _line(line, has_name=len(chart.lines) > 1)


def _line(line: Line, *, has_name: bool) -> dict[str, Any]:
    rows = evenly(len(line.seconds), MOST_POSES)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": line.name,
        "x": line.seconds[rows].astype(np.float32),
        "y": np.asarray(line.values)[rows].astype(np.float32),
        "line": {"color": line.colour, "width": 1},
        "hovertemplate": "%{y:.4g}" if has_name else "%{y:.4g}<extra></extra>",
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


def _figure(chart: Chart, *, is_last: bool) -> dict[str, Any]:
    named = chart.lines if len(chart.lines) > 1 else []
    names = "  ".join(f'<span style="color:{line.colour}">{line.name}</span>' for line in named)
    foot = _LAST_FOOT_PIXELS if is_last else _FOOT_PIXELS
    layout: dict[str, Any] = {
        "height": _HEAD_PIXELS + _PLOT_PIXELS + foot,
        "showlegend": False,
        "plot_bgcolor": "#ffffff",
        "hovermode": "x",
        "margin": {"l": 52, "r": 12, "t": _HEAD_PIXELS, "b": foot},
        "uirevision": "kept",
        "xaxis": {
            "title": {"text": "time [s]" if is_last else ""},
            "automargin": False,
            "hoverformat": ".2f",
            "showspikes": True,
            "spikemode": "across",
            "spikethickness": 1,
            "spikedash": "solid",
            **_GRID,
        },
        "yaxis": {"nticks": 5, "automargin": False, **_GRID, **_axis(chart)},
        "annotations": [
            {
                "text": f"<b>{chart.title}</b>  {names}",
                "x": 0.0,
                "y": 1.0,
                "xref": "paper",
                "yref": "paper",
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 12},
            }
        ],
    }
    return {"data": list(_traces(chart)), "layout": layout}
