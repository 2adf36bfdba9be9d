# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What all pictures share: colours, so that one means the same in all of them, grid, titles."""

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import LogFormatter

from vislam_ros.data.evaluation.evaluate import length_words
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import path_length

ESTIMATE = "#c1272d"
SMOOTHED = "#0b7a75"
DEAD_RECKONING = "#7f7f7f"
REFERENCE = "#1a1a1a"
OTHER = "#2e8b57"
LANDMARK = "#6b8fb3"
OBSERVED = "#b0b0b0"
REPORT_PATH = "red"
"""The report draws its paths in red."""
START, END = "#1f77b4", "#ff7f0e"
FIELD = "viridis_r"
"""Colour map of a field over two settings: dark is large."""
ABOUT_ONE = "PuOr_r"
"""Colour map of a ratio that is best at one: there it is pale."""

SIGMA = "\N{GREEK SMALL LETTER SIGMA}"

DOTS_PER_INCH = 150

_GRID = "#e6e6e6"


def draw_grid(axes: Axes) -> None:
    """Draw a faint grid behind what the axes show."""
    axes.grid(visible=True, color=_GRID, linewidth=0.6)


class _PlainNumbers(LogFormatter):
    """0.6 and 300 where matplotlib would write powers of ten."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers."""
    axis.set_major_formatter(_PlainNumbers())
    axis.set_minor_formatter(_PlainNumbers(minor_thresholds=(1.0, 0.4)))


def layout() -> ConstrainedLayoutEngine:
    """Layout that keeps titles and labels off the picture's edge."""
    return ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1)


def title(results: Results) -> str:
    """Name of the drive, the filter and the length of the path."""
    parts = [results.name, length_words(path_length(results.trajectory))]
    if estimator := results.summary.get("estimator"):
        parts.insert(1, str(estimator))
    return "  ·  ".join(parts)


def finish_series(figure: Figure, text: str) -> None:
    """Give a figure of series over one time its grids, legends and title."""
    for axes in figure.axes:
        draw_grid(axes)
        axes.set_axisbelow(True)
        axes.margins(x=0.01)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9, frameon=False)
    figure.suptitle(text, fontsize=11)
    figure.align_ylabels()
