# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The drive from above with what the filter knows of its error, and its heights."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.evaluate import length_words
from vislam_ros.data.evaluation.laid_paths import LaidPath, LaidPaths, Laying, laid_paths
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

# Paths that lie on each other are all to be seen: the narrower above, the dashed one on top.
_STYLES = {
    "dead reckoning": (palette.DEAD_RECKONING, "-", 1.2, 2),
    "estimate": (palette.ESTIMATE, "-", 2.8, 3),
    "smoothed": (palette.SMOOTHED, "-", 1.5, 4),
    "reference": (palette.REFERENCE, (0, (5, 6)), 0.9, 5),
}
_ELLIPSES = 14
# The largest ellipse is to be seen, and not to hide the drive: its share of the picture.
_LARGEST_SHARE = 0.06
_SHARE_INSIDE = 0.95


def draw_trajectory(
    results: Results, reference: Trajectory | None = None, laying: Laying = "se3"
) -> Figure:
    """Draw the drive from above, as a figure, and its heights below.

    Landmarks are faint points, cut off outside the drive's surroundings; the start is blue and
    the end orange, as in the report. Errors in the legend are distances of what is drawn.
    """
    laid = laid_paths(results, reference, laying)
    corners = np.concatenate([path.positions[:, :2] for path in laid.paths])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = max(0.08 * float(np.max(high - low)), 5.0)
    low, high = low - margin, high + margin
    width, height = _size(high - low)
    figure = Figure(figsize=(width, height + 2.4), layout=palette.layout())
    above, profile = figure.subplots(2, height_ratios=[height, 1.6])
    _draw_landmarks(above, results, low, high)
    for path in laid.paths:
        color, style, line, order = _STYLES[path.name]
        above.plot(
            *path.positions[:, :2].T,
            linestyle=style,
            color=color,
            linewidth=line,
            label=_label(path, laying),
            zorder=order,
        )
    _draw_ellipses(above, results, float(np.max(high - low)))
    _draw_ends(above, results.trajectory.positions)
    if results.dead_reckoning is not None and laid.get("dead reckoning") is None:
        above.plot([], [], " ", label="no dead reckoning: no velocity")
    above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    above.set_aspect("equal")
    _draw_heights(profile, results, laid)
    for axes in (above, profile):
        palette.draw_grid(axes)
        axes.set_axisbelow(True)
    above.set_title(_title(results, laid), fontsize=11, pad=10)
    handles, labels = above.get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False
    )
    for handle in legend.legend_handles:
        if handle is not None and str(handle.get_label()).startswith("landmarks"):
            handle.set(markersize=6, alpha=1.0)
    return figure


def _draw_landmarks(axes: Axes, results: Results, low: Array, high: Array) -> None:
    if results.landmarks is None:
        return
    points = results.landmarks.positions[:, :2]
    points = points[np.all((points > low) & (points < high), axis=1)]
    # So that many of them leave the paths to be seen.
    alpha = float(np.clip(2000.0 / max(len(points), 1), 0.12, 0.5))
    axes.plot(
        *points.T,
        ".",
        color=palette.LANDMARK,
        markersize=2.5,
        markeredgewidth=0,
        alpha=alpha,
        label=f"landmarks ({len(results.landmarks)})",
        zorder=1,
        rasterized=True,
    )


def _draw_ends(axes: Axes, positions: Array) -> None:
    for name, row, color in (("start", 0, palette.START), ("end", -1, palette.END)):
        axes.plot(
            *positions[row, :2],
            "o",
            color=color,
            markersize=8,
            markeredgecolor="white",
            label=name,
            linestyle="none",
            zorder=7,
        )


def map_covariances(results: Results) -> Array:
    """Covariances (N, 3, 3) of the positions in map axes: those of rho, turned by the pose."""
    R = se3.rotation_from_quaternion(results.trajectory.quaternions)
    return R @ results.covariances[:, :3, :3] @ np.swapaxes(R, 1, 2)


def _draw_ellipses(axes: Axes, results: Results, extent: float) -> None:
    """Ellipses that hold the position, some along the way; enlarged where they would be dots."""
    covariances = map_covariances(results)[:, :2, :2]
    known = np.flatnonzero(np.isfinite(covariances).all(axis=(1, 2)))
    if not len(known):
        return
    rows = known[np.unique(np.linspace(0, len(known) - 1, _ELLIPSES + 1).astype(int))[1:]]
    values, vectors = np.linalg.eigh(covariances[rows])
    axes_lengths = np.sqrt(chi2.ppf(_SHARE_INSIDE, 2) * np.maximum(values, 0.0))
    if not len(rows) or not np.max(axes_lengths) > 0.0:
        return
    scale = _magnification(_LARGEST_SHARE * extent / (2.0 * float(np.max(axes_lengths))))
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outlines = vectors @ (scale * axes_lengths[:, :, None] * circle)
    centres = results.trajectory.positions[rows, :2]
    label = f"{_SHARE_INSIDE:.0%} ellipses" + (f", {scale:g} times as large" if scale > 1 else "")
    axes.add_collection(
        PolyCollection(
            list(np.swapaxes(outlines, 1, 2) + centres[:, None, :]),
            facecolor="none",
            edgecolor=palette.ESTIMATE,
            linewidth=0.9,
            alpha=0.8,
            zorder=6,
            label=label,
        ),
        autolim=False,
    )


def _magnification(largest: float) -> float:
    """Greatest 1, 2 or 5 times a power of ten up to a number; 1 where it is smaller."""
    if largest <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(largest))
    return float(max(digit * power for digit in (1, 2, 5) if digit * power <= largest))


def _draw_heights(axes: Axes, results: Results, laid: LaidPaths) -> None:
    origin = int(results.trajectory.stamps[0])
    for path in laid.paths:
        color, style, line, order = _STYLES[path.name]
        seconds = (path.stamps - origin) * 1e-9
        axes.plot(
            seconds,
            path.positions[:, 2],
            linestyle=style,
            color=color,
            linewidth=0.8 * line,
            zorder=order,
        )
    seconds = (results.trajectory.stamps - origin) * 1e-9
    variances = map_covariances(results)[:, 2, 2]
    if np.isfinite(variances).any():
        z, std = results.trajectory.positions[:, 2], np.sqrt(np.maximum(variances, 0.0))
        axes.fill_between(
            seconds,
            z - 3 * std,
            z + 3 * std,
            color=palette.ESTIMATE,
            alpha=0.15,
            linewidth=0,
            zorder=1,
        )
    axes.set(xlabel=r"time [s]  (band: ± 3 $\sigma$)", ylabel="z [m]")
    axes.margins(x=0.01)


def _label(path: LaidPath, laying: Laying) -> str:
    if path.rmse is None:
        return path.name
    # The ATE is what is left after the best alignment, and an end's distance is more.
    word = "ATE" if laying != "first" else "RMS error"
    return f"{path.name}, {word} {length_words(path.rmse)}"


def _title(results: Results, laid: LaidPaths) -> str:
    title = palette.title(results)
    if laid.laying:
        title += f"\n{laid.laying}" + (": not unique" if laid.ambiguity else "")
    return title


def _size(extent: Array) -> tuple[float, float]:
    """Inches that fit a map of this extent in metres, with room for its labels."""
    scale = 8.0 / float(np.max(extent))
    width, height = np.maximum(extent * scale, 2.5)
    return max(float(width), 6.5) + 0.9, float(height) + 1.4
