# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of a sweep: error and consistency against what was swept."""

import io
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vislam_ros.data.pictures import palette
from vislam_ros.data.sweeps.plan import SweepPlan
from vislam_ros.data.sweeps.table import PointResult, value_text

_LABELS = {
    "ate_m": "ATE, aligned [m]",
    "nees_per_dof": "NEES / 6",
    "nis_per_dof": "NIS / dof",
    "rejected_fraction": "rejected share",
}
_WITH_TRUTH, _WITHOUT = ("ate_m", "nees_per_dof"), ("nis_per_dof", "rejected_fraction")
#: A consistent filter has these at one.
_IDEAL_ONE = ("nees_per_dof", "nis_per_dof")
_LEAST_RATIO = 2.0  # colours of ratios reach at least so far, so that noise is pale
_LOG_SPAN = 20.0  # values that span more than this are drawn on a logarithmic scale


def draw_sweep(plan: SweepPlan, points: Sequence[PointResult]) -> Figure:
    """Draw ATE and NEES, or without a reference NIS and rejections, side by side.

    One swept setting gives a line with the single runs as dots; two or more a chart of coloured
    fields, the last setting along x; none, which is a Monte-Carlo, a dot for each seed.

    Parameters
    ----------
    plan : SweepPlan
    points : sequence of PointResult
        Of this plan.
    """
    figures = _WITH_TRUTH if any(point.values("ate_m") for point in points) else _WITHOUT
    axes_of_plan = plan.axes
    rows = len(points) // len(list(axes_of_plan.values())[-1]) if len(axes_of_plan) > 1 else 1
    height = max(4.2, 0.5 * rows + 2.0)
    figure = Figure(figsize=(11.5, height), layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1))
    for axes, name in zip(figure.subplots(1, len(figures)), figures, strict=True):
        if not any(point.values(name) for point in points):
            axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes)
            axes.set(xticks=[], yticks=[])
        elif not axes_of_plan:
            _draw_seeds(axes, points[0], name)
        elif len(axes_of_plan) == 1:
            _draw_line(axes, plan, points, name)
        else:
            _draw_fields(axes, plan, points, name)
        axes.set_title(_LABELS[name], fontsize=11)
    failed = sum(len(point.errors) for point in points)
    count = sum(len(point.rows) for point in points) + failed
    text = f"{count} runs" + (f", {failed} failed" if failed else "")
    figure.suptitle(text, fontsize=10, color=palette.DEAD_RECKONING)
    return figure


def picture_bytes(figure: Figure) -> bytes:
    """Return a figure as a PNG file."""
    content = io.BytesIO()
    figure.savefig(content, dpi=palette.DOTS_PER_INCH, format="png")
    return content.getvalue()


def _draw_seeds(axes: Axes, point: PointResult, name: str) -> None:
    known = [row for row in point.rows if row.get(name) is not None]
    values = [row[name] for row in known]
    axes.plot(
        [row["seed"] for row in known], values, "o", color=palette.DEAD_RECKONING, label="run"
    )
    axes.axhline(
        float(np.mean(values)), color=palette.ESTIMATE, label=f"mean {np.mean(values):.4g}"
    )
    axes.set_xlabel("seed")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    _finish(axes, name, values)


def _draw_line(axes: Axes, plan: SweepPlan, points: Sequence[PointResult], name: str) -> None:
    ((setting, settings),) = plan.axes.items()
    numbers = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in settings)
    place = {repr(value): float(value if numbers else k) for k, value in enumerate(settings)}
    x, y, means = [], [], []
    for point in points:
        here = place[repr(point.point[setting])]
        values = point.values(name)
        x += [here] * len(values)
        y += values
        if values:
            means.append((here, float(np.mean(values))))
    if len(x) > len(means):
        axes.plot(x, y, ".", color=palette.DEAD_RECKONING, markersize=5, label="run")
    means.sort()
    style = "o-" if numbers else "o"
    axes.plot(
        *np.transpose(means),
        style,
        color=palette.ESTIMATE,
        label="mean" if len(x) > len(means) else None,
    )
    axes.set_xlabel(setting)
    if numbers:
        if min(settings) > 0 and max(settings) / min(settings) > _LOG_SPAN:
            axes.set_xscale("log")
            palette.plain_numbers(axes.xaxis)
    else:
        axes.set_xticks(range(len(settings)), [value_text(value) for value in settings])
        axes.margins(x=0.2)
    _finish(axes, name, y)


def _finish(axes: Axes, name: str, values: Sequence[float]) -> None:
    if name in _IDEAL_ONE:
        axes.axhline(
            1.0, color=palette.REFERENCE, linewidth=0.9, linestyle="--", label="consistent"
        )
    if min(values) > 0 and max(values) / min(values) > _LOG_SPAN:
        axes.set_yscale("log")
        palette.plain_numbers(axes.yaxis)
    else:
        axes.set_ylim(0, 1.08 * max(*values, 1e-12, 1.0 if name in _IDEAL_ONE else 0.0))
    palette.draw_grid(axes)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=9, frameon=False)


def _draw_fields(axes: Axes, plan: SweepPlan, points: Sequence[PointResult], name: str) -> None:
    *others, along = plan.axes
    columns = [value_text(value) for value in plan.axes[along]]
    rows = [
        ", ".join(
            value_text(value) if len(others) == 1 else f"{_short(key)}={value_text(value)}"
            for key, value in point.point.items()
            if key != along
        )
        for point in points[:: len(columns)]
    ]
    means = [point.mean(name) for point in points]
    field: NDArray[np.float64] = np.array(
        [np.nan if mean is None else mean for mean in means]
    ).reshape(len(rows), len(columns))
    norm, colours, words = _scale(field, name)
    image = axes.imshow(field, norm=norm, cmap=colours, aspect="auto")
    bar = axes.figure.colorbar(image, ax=axes)
    bar.set_label(words)
    if name in _IDEAL_ONE:
        low, high = image.get_clim()
        ends = [float(low or 1.0), 1.0, float(high or 1.0)]
        bar.set_ticks(ends, labels=[f"{end:.2g}" for end in ends])
        bar.minorticks_off()
    elif isinstance(norm, LogNorm):
        palette.plain_numbers(bar.ax.yaxis)
    for (row, column), value in np.ndenumerate(field):
        text, colour = "-", palette.REFERENCE
        if np.isfinite(value):
            text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
            red, green, blue, _ = colours(float(norm(float(value))))
            colour = "white" if 0.3 * red + 0.59 * green + 0.11 * blue < 0.5 else palette.REFERENCE
        axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=9)
    axes.set_xticks(range(len(columns)), columns)
    axes.set_yticks(range(len(rows)), rows)
    axes.set(xlabel=along, ylabel=others[0] if len(others) == 1 else "")


def _scale(field: NDArray[np.float64], name: str) -> tuple[Normalize, Colormap, str]:
    """Norm and colours of a field of values, and in words which of them are the better ones."""
    low, high = float(np.nanmin(field)), float(np.nanmax(field))
    if name in _IDEAL_ONE and low > 0:
        # Half as much is as wrong as twice as much; 1 is in the middle, and pale.
        widest = max(high, 1.0 / low, _LEAST_RATIO)
        words = "too cautious  ←  1 is best  →  too sure"
        return LogNorm(1.0 / widest, widest), matplotlib.colormaps[palette.ABOUT_ONE], words
    logarithmic = low > 0 and high / low > _LOG_SPAN
    norm = LogNorm(low, high) if logarithmic else Normalize(low, high)
    words = "better  ←  →  worse" if name != "rejected_fraction" else "fewer  ←  →  more"
    return norm, matplotlib.colormaps[palette.FIELD], words


def _short(setting: str) -> str:
    return setting.partition(".")[2]
