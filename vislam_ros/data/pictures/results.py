# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a result directory: the drive from above, and what the filter did at each step."""

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from scipy.stats import chi2

from vislam_ros.core.step import StepTotals
from vislam_ros.data.evaluation.alignment import first_pose_alignment
from vislam_ros.data.evaluation.evaluate import compare, path_length
from vislam_ros.data.files.inputs import open_input
from vislam_ros.data.files.whole_file import made_directory, refuse_existing, replace_files
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_BAND = 0.95

# A text of PNG that tells a picture which nobody asked for from one that somebody did.
_MARK, _OF_RUN = "Source", "vislam run"
_HEAD = 1024  # bytes of a picture, in which its texts stand


def plot_results(
    results: Results,
    reference: Trajectory | None = None,
    *,
    output: Path | None = None,
    force: bool = False,
    of_run: bool = False,
) -> list[Path]:
    """Write ``trajectory.png`` and, where steps were recorded, ``steps.png``.

    Parameters
    ----------
    results : Results
    reference : Trajectory, optional
        Drawn in the map frame: its first pose in common with the estimate is laid onto the
        estimate's, which is how a filter that starts at the origin sees the truth.
    output : Path, optional
        Folder for the pictures; the result directory by default.
    force : bool
        Replace pictures that exist. Those that a run drew at its end are replaced anyway.
    of_run : bool
        Whether a run draws them at its end.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    VislamError
        Where a picture exists and ``force`` is not given, or the reference is of another drive.
    """
    folder = results.directory if output is None else output
    pictures = {"trajectory.png": draw_trajectory}
    if len(results.steps["stamp"]):
        pictures["steps.png"] = draw_steps
    for name in pictures:
        refuse_existing(folder / name, force=force or _is_of_run(folder / name))
    metadata = {_MARK: _OF_RUN} if of_run else {}
    contents = {}
    for name, draw in pictures.items():
        buffer = io.BytesIO()
        draw(results, reference).savefig(
            buffer, dpi=palette.DOTS_PER_INCH, format="png", metadata=metadata
        )
        contents[folder / name] = buffer.getvalue()
    try:
        with made_directory(folder):
            replace_files(contents)
    except OSError as error:
        raise VislamError(f"{folder}: cannot hold pictures: {error.strerror}") from error
    return list(contents)


def _is_of_run(picture: Path) -> bool:
    """Whether a run drew this picture at its end."""
    if not picture.is_file():
        return False
    with open_input(picture, "this picture") as file:
        head = file.read(_HEAD)
    return f"tEXt{_MARK}\0{_OF_RUN}".encode() in head


def draw_trajectory(results: Results, reference: Trajectory | None = None) -> Figure:
    """Draw the drive from above, as a figure.

    Landmarks are faint points, cut off outside the drive's surroundings; the start is blue and
    the end orange, as in the report.
    """
    paths = [("estimate", results.trajectory.positions, palette.ESTIMATE, "-", 1.8, 4)]
    if results.smoothed is not None:
        paths.append(("smoothed", results.smoothed.positions, palette.SMOOTHED, "-", 1.2, 5))
    if results.dead_reckoning is not None and results.dead_reckoning.positions.any():
        # Where a gyroscope alone measures the motion, it stays where it was.
        prediction = results.dead_reckoning.positions
        paths.append(("dead reckoning", prediction, palette.DEAD_RECKONING, "-", 1.2, 2))
    if reference is not None:
        truth = _in_map(reference, results.trajectory)
        paths.append(("reference", truth, palette.REFERENCE, "--", 1.2, 3))

    corners = np.concatenate([path[:, :2] for _, path, *_ in paths])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = max(0.08 * float(np.max(high - low)), 5.0)
    low, high = low - margin, high + margin
    figure = Figure(figsize=_figure_size(high - low), layout=_layout())
    axes = figure.add_subplot()
    if results.landmarks is not None:
        points = results.landmarks.positions[:, :2]
        points = points[np.all((points > low) & (points < high), axis=1)]
        axes.plot(
            *points.T,
            ".",
            color=palette.LANDMARK,
            markersize=2.5,
            markeredgewidth=0,
            alpha=0.5,
            label=f"landmarks ({len(results.landmarks)})",
            zorder=1,
            rasterized=True,
        )
    for name, path, color, style, width, order in paths:
        axes.plot(
            *path[:, :2].T,
            linestyle=style,
            color=color,
            linewidth=width,
            label=name,
            zorder=order,
        )
    for name, row, color in (("start", 0, palette.START), ("end", -1, palette.END)):
        axes.plot(
            *results.trajectory.positions[row, :2],
            "o",
            color=color,
            markersize=8,
            markeredgecolor="white",
            label=name,
            linestyle="none",
            zorder=6,
        )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")
    palette.draw_grid(axes)
    axes.set_axisbelow(True)
    axes.set_title(_title(results, reference), fontsize=11, pad=10)
    legend = figure.legend(loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    for handle in legend.legend_handles:
        if handle is not None and str(handle.get_label()).startswith("landmarks"):
            handle.set(markersize=6, alpha=1.0)
    return figure


def draw_steps(results: Results, reference: Trajectory | None = None) -> Figure:
    """Draw landmarks, rejections, consistency, time and height against the drive's seconds."""
    steps = results.steps
    origin = int(results.trajectory.stamps[0])
    seconds = (steps["stamp"] - origin) * 1e-9
    figure = Figure(figsize=(10.0, 11.0), layout=_layout())
    landmarks, rejections, consistency, duration, height = figure.subplots(5, sharex=True)

    landmarks.plot(
        seconds, steps["observed"], color=palette.OBSERVED, linewidth=0.9, label="observed"
    )
    landmarks.plot(seconds, steps["active"], color=palette.SMOOTHED, linewidth=0.9, label="active")
    used = np.where(steps["frozen"], np.nan, steps["used"])
    landmarks.plot(seconds, used, color=palette.ESTIMATE, linewidth=0.9, label="used")
    landmarks.set(ylabel="landmarks", ylim=(0, None))

    rejections.vlines(seconds, 0, steps["rejected"], color=palette.ESTIMATE, linewidth=0.9)
    rejections.set(ylabel="rejected", ylim=(0, max(1.0, 1.1 * np.max(steps["rejected"]))))

    totals = StepTotals.of_table(steps)
    _draw_consistency(consistency, seconds, steps["nis"], steps["nis_dof"], totals)

    duration.plot(seconds, steps["ms"], color=palette.ESTIMATE, linewidth=0.6)
    for percent, style in ((50, "-"), (99, "--")):
        late = totals.ms_percentile(percent) or 0.0
        label = f"p{percent} {late:.1f} ms"
        duration.axhline(
            late, color=palette.REFERENCE, linewidth=0.9, linestyle=style, label=label
        )
    duration.set(ylabel="step [ms]", ylim=(0, max(1.5 * late, 1e-3)))

    heights = [("estimate", results.trajectory, results.trajectory.positions, palette.ESTIMATE)]
    if reference is not None:
        truth = _in_map(reference, results.trajectory)
        heights.append(("reference", reference, truth, palette.REFERENCE))
    for name, trajectory, positions, color in heights:
        times = (trajectory.stamps - origin) * 1e-9
        height.plot(times, positions[:, 2], color=color, linewidth=1.2, label=name)
    height.set(ylabel="z [m]", xlabel="time [s]")

    frozen = seconds[steps["frozen"]]
    if len(frozen):
        bottom_ticks = {"ymin": 0, "ymax": 0.06, "transform": landmarks.get_xaxis_transform()}
        landmarks.vlines(
            frozen, **bottom_ticks, color=palette.START, linewidth=1.0, label="frozen frame"
        )
    for axes in (landmarks, rejections, consistency, duration, height):
        palette.draw_grid(axes)
        axes.set_axisbelow(True)
        axes.margins(x=0.01)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9, frameon=False)
    figure.suptitle(_title(results, reference), fontsize=11)
    figure.align_ylabels()
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
    low, high = (chi2.ppf(p, dof) / dof for p in ((1 - _BAND) / 2, (1 + _BAND) / 2))
    axes.fill_between(
        seconds, low, high, color=palette.START, alpha=0.2, linewidth=0, label="95 % band"
    )
    axes.plot(seconds, nis / dof, ".", color=palette.ESTIMATE, markersize=3, label="each step")
    mean = totals.nis_per_dof or 0.0
    axes.axhline(mean, color=palette.REFERENCE, linewidth=0.9, label=f"mean {mean:.2f}")
    axes.set_ylim(0, max(2.0, 1.2 * float(np.percentile(nis / dof, 99))))


def _in_map(reference: Trajectory, estimate: Trajectory) -> Array:
    """Positions (N, 3) of the reference with its first pose in common laid onto the estimate's."""
    T = first_pose_alignment(reference, estimate)
    return (T @ reference.T_world_body)[:, :3, 3]


def _title(results: Results, reference: Trajectory | None) -> str:
    estimator = results.summary.get("estimator")
    parts = [results.name, f"{path_length(results.trajectory):.0f} m"]
    if estimator:
        parts.insert(1, str(estimator))
    if reference is not None:
        figures = compare(reference, results.trajectory)
        parts.append(f"ATE {figures['ate_m']['rmse']:.2f} m")
        if results.dead_reckoning is not None:
            figures = compare(reference, results.dead_reckoning)
            parts[-1] += f" (dead reckoning {figures['ate_m']['rmse']:.1f} m)"
    return "  ·  ".join(parts)


def _layout() -> ConstrainedLayoutEngine:
    """Layout that keeps titles and labels off the picture's edge."""
    return ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1)


def _figure_size(extent: Array) -> tuple[float, float]:
    """Inches that fit a map of this extent in metres, with room for its labels."""
    scale = 8.0 / float(np.max(extent))
    width, height = np.maximum(extent * scale, 2.5)
    return max(float(width), 6.0) + 0.9, float(height) + 1.6
