# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The charts of a result in the viewer."""

from collections.abc import Sequence

import numpy as np

from vislam_ros.data.pictures.charts import Chart, Line
from vislam_ros.data.viewing.stream import TIMELINE, Stream, rerun
from vislam_ros.data.viewing.world import rgb


def log_charts(stream: Stream, charts: Sequence[Chart]) -> None:
    """Log each line of each chart under ``series/CHART``, bands as two lines."""
    for chart in charts:
        for line in (*chart.lines, *_edges(chart)):
            _log_line(stream, f"series/{chart.key}/{line.name.replace(' ', '_')}", line)


def _edges(chart: Chart) -> list[Line]:
    names = [line.name for line in chart.lines] if len(chart.bands) > 1 else [""]
    return [
        Line(f"{name} {end}".strip(), band.seconds, values, band.colour)
        for name, band in zip(names, chart.bands, strict=False)
        for end, values in (("low", band.low), ("high", band.high))
    ]


def _log_line(stream: Stream, path: str, line: Line) -> None:
    library = rerun()
    is_edge = line.name.endswith(("low", "high"))
    style = library.SeriesLines(
        colors=[rgb(line.colour)], names=line.name, widths=0.5 if is_edge else 1.2
    )
    stream.log(path, style, static=True)
    values = np.asarray(line.values, dtype=float)
    known = np.isfinite(values)
    stream.send_columns(
        path,
        indexes=[library.TimeColumn(TIMELINE, duration=line.seconds[known])],
        columns=library.Scalars.columns(scalars=values[known]),
    )
