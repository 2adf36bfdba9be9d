# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report's figures 2 to 6, drawn: the path red, its start blue, its end orange."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from report.experiments import EXPERIMENTS, ExperimentResult
from vislam_ros.data.evaluation.alignment import first_pose_alignment
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.pictures import palette
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

_MARGIN = 0.08  # of the extent of what is drawn
_FARTHEST = 1.0  # a path that runs away is drawn so many extents of the other paths afar


@dataclass(frozen=True)
class ReportFigure:
    """One figure of the report.

    Attributes
    ----------
    title : str
    experiments : tuple of str
        One panel each; none for the dead reckoning alone.
    beside : str or None
        Experiment whose path is drawn, too, for comparison.
    with_reference : bool
        Whether the truth is drawn, where it is known.
    """

    title: str
    experiments: tuple[str, ...] = ()
    beside: str | None = None
    with_reference: bool = True


#: File name without suffix -> figure.
FIGURES = {
    "figure_2": ReportFigure("Figure 2: dead reckoning"),
    "figure_3": ReportFigure(
        "Figure 3: visual-inertial SLAM with 33 % of the features", ("table_i_33",)
    ),
    "figure_4": ReportFigure(
        "Figure 4: 33 % of the features, effect of the observation noise V and of W",
        ("v_0.01", "v_1", "table_i_33", "v_10000", "w_1e-9", "w_1e-8"),
    ),
    "figure_5": ReportFigure(
        "Figure 5: 50 % of the features, large prior covariance",
        ("large_prior_50",),
        "table_i_50",
        with_reference=False,
    ),
    "figure_6": ReportFigure(
        "Figure 6: 50 % of the features, small prior covariance",
        ("small_prior_50",),
        "table_i_50",
        with_reference=False,
    ),
    "recommended": ReportFigure("Not in the report: the recommended settings", ("recommended",)),
}

#: Every experiment that a figure shows.
SHOWN = tuple(
    name
    for name in EXPERIMENTS
    if any(name in (*figure.experiments, figure.beside) for figure in FIGURES.values())
)


#: Positions (N, 3) with colour, line style, line width and label.
_Path: TypeAlias = tuple[Array, str, str, float, str]


@dataclass(frozen=True)
class _Panel:
    """What one panel shows; the first path is the one in question."""

    title: str
    paths: list[_Path]
    landmarks: Array


def draw_figure(
    figure: ReportFigure,
    results: Mapping[str, ExperimentResult],
    reference: Trajectory | None,
    drive: str,
) -> Figure:
    """Draw a figure, each panel from above, with its numbers as a caption.

    Parameters
    ----------
    figure : ReportFigure
    results : mapping of str to ExperimentResult
        Of all experiments that the figure names, and of one at least.
    reference : Trajectory, optional
        The truth about the drive, laid onto each path's first pose.
    drive : str
        Its name.
    """
    beside = results[figure.beside] if figure.beside else None
    drawn = reference if figure.with_reference else None
    panels = [
        _experiment_panel(name, results[name], beside, reference, drawn)
        for name in figure.experiments
    ] or [_dead_reckoning_panel(next(iter(results.values())).dead_reckoning, reference)]

    low, high = _view(panels)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    width, height = (high - low) * (6.8 if len(panels) == 1 else 4.8) / np.max(high - low)
    picture = Figure(
        figsize=(max(columns * (width + 0.7), 8.0), rows * (height + 1.3) + 0.8),
        layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08),
    )
    grid = picture.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _draw_panel(axes, panel, low, high)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    picture.suptitle(f"{figure.title}  ·  {drive}", fontsize=12)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    legend = picture.legend(
        handles, labels, loc="outside lower center", ncols=6, fontsize=9, frameon=False
    )
    for handle in legend.legend_handles:
        if handle is not None and handle.get_label() == "landmarks":
            handle.set(markersize=6, alpha=1.0)
    return picture


def _dead_reckoning_panel(trajectory: Trajectory, reference: Trajectory | None) -> _Panel:
    paths: list[_Path] = [(trajectory.positions, palette.REPORT_PATH, "-", 2.0, "path")]
    caption = f"{np.ptp(trajectory.positions[:, 2]):.0f} m of height"
    if reference is not None:
        paths.append((_laid_on(reference, trajectory), palette.REFERENCE, "--", 0.9, "reference"))
        caption = f"ATE {compare(reference, trajectory)['ate_m']['rmse']:.1f} m, {caption}"
    return _Panel(f"twists summed up\n{caption}", paths, np.empty((0, 3)))


def _experiment_panel(
    name: str,
    result: ExperimentResult,
    beside: ExperimentResult | None,
    reference: Trajectory | None,
    drawn_reference: Trajectory | None,
) -> _Panel:
    trajectory = result.trajectory
    paths: list[_Path] = [
        (trajectory.positions, palette.REPORT_PATH, "-", 2.0, "path"),
        (result.dead_reckoning.positions, palette.DEAD_RECKONING, "-", 0.9, "dead reckoning"),
    ]
    if beside is not None:
        paths.append((beside.trajectory.positions, palette.OTHER, "-.", 1.2, "prior of Table I"))
    if drawn_reference is not None:
        paths.append(
            (_laid_on(drawn_reference, trajectory), palette.REFERENCE, "--", 0.9, "reference")
        )
    title = f"{EXPERIMENTS[name].title}\n{_caption(result, reference)}"
    return _Panel(title, paths, result.landmarks)


def _caption(result: ExperimentResult, reference: Trajectory | None) -> str:
    figures = result.figures(reference)
    if figures["finite_poses"] != figures["poses"]:
        return f"diverged: {figures['finite_poses']} of {figures['poses']} poses are finite"
    caption = f"{figures['from_dead_reckoning_m']:.1f} m from dead reckoning"
    if figures["ate_m"] is not None:
        caption = f"ATE {figures['ate_m']:.1f} m, {caption}"
    if figures["landmark_distance_m"] is not None:
        caption += (
            f"\nlandmarks from the path: median {figures['landmark_distance_m']:.1f} m, "
            f"90 % within {figures['landmark_distance_90_m']:.0f} m"
        )
    return caption


def _draw_panel(axes: Axes, panel: _Panel, low: Array, high: Array) -> None:
    points = panel.landmarks[:, :2]
    with np.errstate(invalid="ignore"):
        points = points[np.all((points > low) & (points < high), axis=1)]
    if len(points):
        axes.plot(
            *points.T,
            ".",
            color=palette.LANDMARK,
            markersize=2.5,
            markeredgewidth=0,
            alpha=0.6,
            label="landmarks",
            zorder=1,
            rasterized=True,
        )
    for order, (path, colour, style, width, label) in enumerate(panel.paths):
        axes.plot(
            *path[:, :2].T,
            style,
            color=colour,
            linewidth=width,
            label=label,
            zorder=3 if order == 0 else 4,
        )
    main = panel.paths[0][0]
    main = main[np.isfinite(main).all(axis=1)]
    for row, colour, label in ((0, palette.START, "start"), (-1, palette.END, "end")):
        axes.plot(
            *main[row, :2],
            "o",
            color=colour,
            markersize=9,
            markeredgecolor="white",
            linestyle="none",
            label=label,
            zorder=6,
        )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axes.label_outer()
    axes.set_aspect("equal")
    palette.draw_grid(axes)
    axes.set_axisbelow(True)
    axes.set_title(panel.title, fontsize=9)


def _view(panels: list[_Panel]) -> tuple[Array, Array]:
    """Corners of the map: all that is drawn, but no farther than a runaway deserves."""

    def corners(paths: list[Array]) -> tuple[Array, Array]:
        points = np.concatenate(paths)[:, :2]
        points = points[np.isfinite(points).all(axis=1)]
        return points.min(axis=0), points.max(axis=0)

    paths = [path for panel in panels for path, *_ in panel.paths]
    steady = [path for panel in panels for path, *_ in panel.paths[1:]] or paths
    (low, high), (least, most) = corners(paths), corners(steady)
    reach = _FARTHEST * float(np.max(most - least))
    low, high = np.maximum(low, least - reach), np.minimum(high, most + reach)
    margin = max(_MARGIN * float(np.max(high - low)), 5.0)
    return low - margin, high + margin


def _laid_on(reference: Trajectory, trajectory: Trajectory) -> Array:
    """Positions (N, 3) of the reference, seen from the trajectory's first pose."""
    T = first_pose_alignment(reference, trajectory)
    return (T @ reference.T_world_body)[:, :3, 3]
