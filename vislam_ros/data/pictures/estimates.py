# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the filter estimates besides pose and map, with three standard deviations."""

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vislam_ros.core.columns import Quantity
from vislam_ros.core.filters.quantities import OF_EVERY_STEP, OF_ROBOCENTRIC
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results

Array = NDArray[np.float64]

_AXIS_COLOURS = (palette.ESTIMATE, palette.SMOOTHED, palette.START)


def quantities_of(steps: Mapping[str, Array]) -> Iterator[Quantity]:
    """Quantities that a table of steps has, and that change in it."""
    for quantity in (*OF_EVERY_STEP, *OF_ROBOCENTRIC):
        if all(name in steps for name in (*quantity.names, *quantity.std_names)) and any(
            np.ptp(steps[name]) > 0.0 for name in quantity.names
        ):
            yield quantity


def settled_range(steps: Mapping[str, Array], quantity: Quantity) -> tuple[float, float] | None:
    """Limits that show a quantity with three deviations once it has settled; None without any.

    The prior's band is a hundred times as wide as what is left of it a moment later, and would
    flatten all that follows: the first twentieth of the drive may leave the picture.
    """
    ends = []
    for k, name in enumerate(quantity.names):
        spread = 3.0 * steps[quantity.std_names[k]] if quantity.std_names else 0.0
        ends += [steps[name] - spread, steps[name] + spread]
    values = np.concatenate([end[len(end) // 20 :] for end in ends])
    values = values[np.isfinite(values)]
    if not len(values) or not np.ptp(values) > 0.0:
        return None
    low, high = float(values.min()), float(values.max())
    return low - 0.08 * (high - low), high + 0.08 * (high - low)


def draw_estimates(results: Results) -> Figure | None:
    """Draw velocity, biases, lens and noise as estimated, as a figure; None where none is."""
    steps = results.steps
    quantities = list(quantities_of(steps)) if len(steps["stamp"]) else []
    if not quantities:
        return None
    seconds = (steps["stamp"] - results.trajectory.stamps[0]) * 1e-9
    figure = Figure(figsize=(10.0, 1.6 * len(quantities) + 1.2), layout=palette.layout())
    rows = figure.subplots(len(quantities), sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(rows, quantities, strict=True):
        _draw(axes, seconds, steps, quantity)
    rows[-1].set_xlabel(r"time [s]  (bands: ± 3 $\sigma$)")
    palette.finish_series(figure, palette.title(results))
    return figure


def _draw(axes: Axes, seconds: Array, steps: Mapping[str, Array], quantity: Quantity) -> None:
    for k, name in enumerate(quantity.names):
        value, colour = steps[name], _AXIS_COLOURS[k]
        label = quantity.axes[k] if quantity.axes else None
        axes.plot(seconds, value, color=colour, linewidth=0.9, label=label)
        if quantity.std_names:
            band = 3.0 * steps[quantity.std_names[k]]
            axes.fill_between(
                seconds, value - band, value + band, color=colour, alpha=0.12, linewidth=0
            )
    limits = settled_range(steps, quantity)
    if limits is not None:
        axes.set_ylim(*limits)
    axes.set_ylabel(quantity.label.replace(" [", "\n[").replace("angular velocity", "ang. vel."))
