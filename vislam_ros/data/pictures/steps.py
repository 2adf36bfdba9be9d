# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the filter did at each step: landmarks, rejections, consistency, time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vislam_ros.core.step import StepTotals
from vislam_ros.data.evaluation.consistency import SHARE_INSIDE, chi_square_band
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results

Array = NDArray[np.float64]


def draw_steps(results: Results) -> Figure:
    """Draw landmarks, rejections, consistency and time against the drive's seconds."""
    steps = results.steps
    origin = int(results.trajectory.stamps[0])
    seconds = (steps["stamp"] - origin) * 1e-9
    figure = Figure(figsize=(10.0, 9.0), layout=palette.layout())
    landmarks, rejections, consistency, duration = figure.subplots(4, sharex=True)

    landmarks.plot(
        seconds, steps["observed"], color=palette.OBSERVED, linewidth=0.9, label="observed"
    )
    landmarks.plot(seconds, steps["active"], color=palette.SMOOTHED, linewidth=0.9, label="active")
    used = np.where(steps["frozen"], np.nan, steps["used"])
    landmarks.plot(seconds, used, color=palette.ESTIMATE, linewidth=0.9, label="used")
    landmarks.set(ylabel="landmarks", ylim=(0, None))

    totals = StepTotals.of_table(steps)
    rejections.vlines(seconds, 0, steps["rejected"], color=palette.ESTIMATE, linewidth=0.9)
    share = totals.rejected_fraction
    if share is not None:
        rejections.plot([], [], color=palette.ESTIMATE, label=f"{share:.2%} of all")
    rejections.set(ylabel="rejected", ylim=(0, max(1.0, 1.1 * np.max(steps["rejected"]))))

    _draw_consistency(consistency, seconds, steps["nis"], steps["nis_dof"], totals)

    duration.plot(seconds, steps["ms"], color=palette.ESTIMATE, linewidth=0.6, label="each step")
    for percent, style in ((50, "-"), (99, "--")):
        late = totals.ms_percentile(percent) or 0.0
        label = f"p{percent} {late:.1f} ms"
        duration.axhline(
            late, color=palette.REFERENCE, linewidth=0.9, linestyle=style, label=label
        )
    # A single step may take a hundred times as long, and would flatten all others.
    above = int(np.sum(steps["ms"] > 1.5 * late))
    if above:
        duration.plot([], [], " ", label=f"{above} step{'s' * (above > 1)} higher")
    duration.set(ylabel="step [ms]", ylim=(0, max(1.5 * late, 1e-3)), xlabel="time [s]")

    frozen = seconds[steps["frozen"]]
    if len(frozen):
        bottom_ticks = {"ymin": 0, "ymax": 0.06, "transform": landmarks.get_xaxis_transform()}
        landmarks.vlines(
            frozen, **bottom_ticks, color=palette.START, linewidth=1.0, label="frozen frame"
        )
    palette.finish_series(figure, palette.title(results))
    return figure


def _draw_consistency(
    axes: Axes, seconds: Array, nis: Array, dof: NDArray[np.int64], totals: StepTotals
) -> None:
    """NIS per degree of freedom with the band that holds 95 % of it in a consistent filter."""
    measured = dof > 0
    seconds, nis, dof = seconds[measured], nis[measured], dof[measured]
    axes.set_ylabel("NIS / dof")
    if not len(dof):
        return
    low, high = chi_square_band(dof)
    axes.fill_between(
        seconds,
        low,
        high,
        color=palette.START,
        alpha=0.2,
        linewidth=0,
        label=f"{SHARE_INSIDE:.0%} band",
    )
    each = nis / dof
    inside = float(np.mean((each >= low) & (each <= high)))
    axes.plot(seconds, each, ".", color=palette.ESTIMATE, markersize=3, label="each step")
    axes.plot([], [], " ", label=f"{inside:.0%} inside")
    mean = totals.nis_per_dof or 0.0
    axes.axhline(mean, color=palette.REFERENCE, linewidth=0.9, label=f"mean {mean:.2f}")
    axes.set_ylim(0, max(2.0, 1.2 * float(np.percentile(each, 99))))
