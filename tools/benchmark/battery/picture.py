# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the battery: a line a row, a dot an error."""

import io
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from vislam_ros.data.pictures import palette

# Names of groups, each with its rows.
_Groups = list[tuple[str, list[Mapping[str, Any]]]]

# Key, label, and how its dot is drawn; the later ones lie over the others.
_DOTS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("dead_reckoning_percent", "dead reckoning", {"marker": "o", "color": palette.DEAD_RECKONING}),
    (
        "beside_percent",
        "the other's estimate",
        {"marker": "o", "facecolors": "none", "edgecolors": palette.REFERENCE, "s": 34},
    ),
    ("smoothed_percent", "smoothed", {"marker": "|", "color": palette.SMOOTHED, "s": 46}),
    ("estimate_percent", "estimate", {"marker": "o", "color": palette.ESTIMATE}),
)
_DOT_SIZE = 20
_INCHES_PER_LINE = 0.165
_GAP = 2  # lines between groups, the title of the second among them
# From so many rows on there are two columns.
_ONE_COLUMN = 40
_MARGIN = 1.25  # of the smallest and the largest error, beyond them


def draw_battery(summed: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of each row's errors per cent of the path, on a logarithmic axis, group by group.

    Parameters
    ----------
    summed : sequence of mapping
        Of :func:`benchmark.battery.summary.summed_rows`.
    """
    columns = _columns(_by_group(summed))
    lines = max(map(_lines, columns))
    figure = Figure(
        figsize=(7.5 * len(columns), _INCHES_PER_LINE * lines + 1.4), layout="constrained"
    )
    limits = _limits(summed)
    axes_of_columns = figure.subplots(1, len(columns), squeeze=False)[0]
    for axes, groups in zip(axes_of_columns, columns, strict=True):
        _draw_column(axes, groups)
        axes.set(xscale="log", xlim=limits, ylim=(lines - 0.5, -0.5), xlabel="error [%]")
        axes.xaxis.set_major_formatter(FuncFormatter(_tick))
        axes.xaxis.set_minor_formatter(FuncFormatter(_tick))
        axes.tick_params(axis="x", which="both", labelsize=8, top=True, labeltop=True)
    dots = [axes.get_legend_handles_labels() for axes in axes_of_columns]
    labelled = {label: dot for column in dots for dot, label in zip(*column, strict=True)}
    handles = list(labelled.values())
    if any(row["worse"] for row in summed):
        handles.append(Line2D([], [], color=palette.ESTIMATE, label="worse than dead reckoning"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    content = io.BytesIO()
    figure.savefig(content, dpi=palette.DOTS_PER_INCH, format="png")
    return content.getvalue()


def _by_group(summed: Sequence[Mapping[str, Any]]) -> _Groups:
    names = dict.fromkeys(row["group"] for row in summed)
    return [(name, [row for row in summed if row["group"] == name]) for name in names]


def _columns(groups: _Groups) -> list[_Groups]:
    """Split groups where the two columns are nearest in length."""
    ends = list(accumulate(len(rows) + _GAP for _, rows in groups))
    if ends[-1] < _ONE_COLUMN or len(groups) < 2:
        return [groups]
    cut = int(np.argmin(np.abs(np.array(ends[:-1]) - ends[-1] / 2))) + 1
    return [groups[:cut], groups[cut:]]


def _lines(groups: _Groups) -> int:
    return sum(len(rows) + _GAP for _, rows in groups)


def _limits(summed: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    errors = [row[key] for row in summed for key, _, _ in _DOTS if row.get(key)]
    if not errors:
        return 0.1, 10.0
    return min(errors) / _MARGIN, max(errors) * _MARGIN


def _draw_column(axes: Axes, groups: _Groups) -> None:
    lines: list[float] = []
    rows: list[Mapping[str, Any]] = []
    top = 0
    for name, of_group in groups:
        axes.text(
            0.0,
            top + 1.0,
            f" {name}",
            transform=axes.get_yaxis_transform(),
            va="center",
            weight="bold",
            fontsize=9,
        )
        lines += [top + _GAP + k for k in range(len(of_group))]
        rows += of_group
        top += _GAP + len(of_group)
    _draw_gains(axes, lines, rows)
    for key, label, style in _DOTS:
        known = [(line, row[key]) for line, row in zip(lines, rows, strict=True) if row.get(key)]
        if known:
            y, x = zip(*known, strict=True)
            axes.scatter(
                x, y, label=label, zorder=3, **{"s": _DOT_SIZE, "linewidths": 1.2, **style}
            )
    axes.set_yticks(lines, [_label(row) for row in rows], fontsize=8)
    axes.tick_params(axis="y", length=0)
    for text, row in zip(axes.get_yticklabels(), rows, strict=True):
        if row["worse"]:
            text.set(color=palette.ESTIMATE, weight="bold")
    palette.draw_grid(axes)
    axes.set_axisbelow(True)


def _draw_gains(axes: Axes, lines: Sequence[float], rows: Sequence[Mapping[str, Any]]) -> None:
    """Join dead reckoning and estimate: in grey what was gained, in red what was lost."""
    for line, row in zip(lines, rows, strict=True):
        ends = row["dead_reckoning_percent"], row["estimate_percent"]
        if None not in ends:
            colour = palette.ESTIMATE if row["worse"] else palette.OBSERVED
            axes.plot(ends, (line, line), color=colour, linewidth=1.2, zorder=2)


def _label(row: Mapping[str, Any]) -> str:
    failed = f" ({row['failed']} failed)" if row["failed"] else ""
    return row["name"] + failed


def _tick(value: float, _: int) -> str:
    """Label of 1, 2 and 5 times a power of ten."""
    lead = f"{value:e}"[0]
    return f"{value:g}" if lead in "125" else ""
