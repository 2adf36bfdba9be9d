# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The colours and the grid of every picture, so that a colour means the same in all of them."""

from matplotlib.axes import Axes

ESTIMATE = "#c1272d"
SMOOTHED = "#0b7a75"
DEAD_RECKONING = "#7f7f7f"
REFERENCE = "#1a1a1a"
OTHER = "#2e8b57"
LANDMARK = "#6b8fb3"
OBSERVED = "#b0b0b0"
REPORT_PATH = "red"
"""The report draws its paths in red."""
START, END = "tab:blue", "tab:orange"
FIELD = "viridis_r"
"""Colour map of a field over two settings: dark is large."""

DOTS_PER_INCH = 150

_GRID = "#e6e6e6"


def draw_grid(axes: Axes) -> None:
    """Draw a faint grid behind what the axes show."""
    axes.grid(visible=True, color=_GRID, linewidth=0.6)
