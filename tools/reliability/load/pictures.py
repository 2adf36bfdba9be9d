# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a soak and of the largest rates."""

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from reliability.load.curve import CurvePoint, largest_rates
from reliability.load.soak import Soak
from vislam_ros.data.pictures import palette

_COLOURS = (palette.ESTIMATE, palette.SMOOTHED, palette.LANDMARK, palette.REFERENCE)


def draw_soak(seen: Soak) -> bytes:
    """PNG of each process's memory over time, relative to its own at the end of the warm-up."""
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axes = figure.subplots()
    minutes = np.asarray(seen.seconds) / 60.0
    start = int(np.searchsorted(seen.seconds, seen.warm_up).clip(max=len(minutes) - 1))
    for (name, values), colour in zip(seen.megabytes.items(), _COLOURS, strict=False):
        label = f"{name}: {values[start]:.0f} MB, {seen.growth(name):+.2f} MB in 10 min"
        axes.plot(minutes, np.asarray(values) - values[start], color=colour, label=label)
    axes.axvline(seen.warm_up / 60.0, color=palette.OBSERVED, linestyle=":")
    settled = np.concatenate([np.asarray(v)[start:] - v[start] for v in seen.megabytes.values()])
    reach = max(5.0, float(np.nanmax(np.abs(settled))) * 1.2)
    axes.set(
        xlabel="minutes",
        ylabel="memory over that after warm-up [MB]",
        ylim=(-reach, reach),
        title=f"{seen.passes} passes at full rate, {seen.same} with the same bytes",
    )
    palette.draw_grid(axes)
    axes.legend()
    return _png(figure)


def draw_curve(points: Sequence[CurvePoint]) -> bytes:
    """PNG of the largest rate for each number of features, and of the latencies behind it."""
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    largest = largest_rates(points)
    left.plot(
        list(largest), [rate or np.nan for rate in largest.values()], "o-", color=palette.ESTIMATE
    )
    for point in points:
        colour = palette.OTHER if point.keeps_up else palette.OBSERVED
        left.plot(point.features, point.rate, "." if point.keeps_up else "x", color=colour)
    left.set(
        xlabel="features in a frame",
        ylabel="frames a second",
        xscale="log",
        yscale="log",
        title="largest rate in real time (x: does not keep up)",
    )
    rates = sorted({point.rate for point in points})
    shades = np.linspace(0.15, 0.95, len(rates))
    for rate, shade in zip(rates, shades, strict=True):
        some = sorted((p for p in points if p.rate == rate), key=lambda p: p.features)
        right.plot(
            [p.features for p in some],
            [p.latency_ms for p in some],
            "o-",
            color=(0.76 * shade, 0.15, 1.0 - shade),
            label=f"{rate:g} Hz",
        )
    right.set(
        xlabel="features in a frame",
        ylabel="feature to odometry, median at the end [ms]",
        xscale="log",
        yscale="log",
        title="latency",
    )
    right.legend()
    for axes in (left, right):
        palette.draw_grid(axes)
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=palette.DOTS_PER_INCH, format="png")
    return buffer.getvalue()
