# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam evaluate``: runs against a reference, a row for each of their estimates."""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer, tell, tell_next
from vislam_ros.cli.screen import table_console
from vislam_ros.data.evaluation.evaluate import WHOLE, evaluate_runs, length_words
from vislam_ros.data.results.writer import note_on_passes
from vislam_ros.errors import one_line

_ESTIMATES = {
    "trajectory": "filtered",
    "smoothed": "smoothed",
    "dead_reckoning": "dead reckoning",
}
_ALIGNMENTS = {
    "se3": "aligned by a rigid motion",
    "yaw": "aligned by yaw and position",
    "none": "not aligned",
}
# Heading, figure, which of its numbers, and the decimals that are shown.
_ERRORS = (
    ("ATE\nRMSE\n[m]", "ate_m", "rmse", 3),
    ("ATE\nmax\n[m]", "ate_m", "max", 3),
    ("RPE\nframe\n[m]", "rpe_frame_m", "rmse", 4),
    ("RPE\nframe\n[deg]", "rpe_frame_deg", "rmse", 4),
    ("RPE\n100 m\n[m]", "rpe_100m_m", "rmse", 3),
    ("RPE\n100 m\n[deg]", "rpe_100m_deg", "rmse", 3),
)

Row = tuple[str, str, Mapping[str, Any]]
"""A run, which of its estimates, and the figures of that."""


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    evaluations = evaluate_runs(
        arguments.runs,
        arguments.reference,
        align=arguments.align,
        max_difference=arguments.max_difference,
    )
    for path in arguments.runs:
        if note := note_on_passes(path):
            tell(f"note: {note}")
    if arguments.json:
        print(json.dumps(evaluations if len(evaluations) > 1 else evaluations[0], indent=2))
        return OK
    rows = [
        (evaluation["run"], _label(evaluation["run"], name), evaluation[name])
        for evaluation in evaluations
        for name in _ESTIMATES
        if name in evaluation
    ]
    length = evaluations[0]["reference_length_m"]
    compared = _compared_words([figures["compared_m"] for *_, figures in rows], length)
    console = table_console()
    answer(
        f"{'' if _has_several(rows) else f'{rows[0][0]} against '}{arguments.reference}, "
        f"{compared}, {_ALIGNMENTS[arguments.align]}"
    )
    console.print(_error_table(rows))
    bounds = next((row[2]["nees_bounds"] for row in rows if "nees_bounds" in row[2]), None)
    if bounds is not None:
        answer(
            "NEES/6 of a filter that knows its error: 1 on average, 95 % of the poses inside "
            f"{bounds[0]:.2f} to {bounds[1]:.2f}"
        )
    if any(figures["kitti"] for _, _, figures in rows):
        answer("errors over stretches of the path: % of its length, and degrees per 100 m")
        console.print(_stretch_table(rows))
    for name, label, figures in rows:
        if figures["alignment_ambiguity"]:
            tell(f"note: {name}, {label}: {figures['alignment_ambiguity']}")
        if missing := figures.get("covariances_missing"):
            tell(
                f"note: {name}, {label}: {missing} of {figures['poses']} poses have no "
                "covariance, and count for no NEES: vislam verify tells more"
            )
    _tell_next(arguments)
    return OK


def _compared_words(parts: Sequence[float], length: float) -> str:
    """Length of the reference that is compared, and how much of the reference that is."""
    whole = length_words(length)
    if min(parts) >= WHOLE * length:
        return whole
    least, most = (length_words(part) for part in (min(parts), max(parts)))
    return f"{most if least == most else f'{least} to {most}'} of its {whole} compared"


def _label(run: str, name: str) -> str:
    """What to call an estimate; nobody knows how that of another program came about."""
    return "trajectory" if Path(run).is_file() else _ESTIMATES[name]


def _tell_next(arguments: argparse.Namespace) -> None:
    directories = [path for path in arguments.runs if path.is_dir()]
    if directories:
        tell_next("plot", str(directories[0]), "--reference", str(arguments.reference))


def _error_table(rows: Sequence[Row]) -> Table:
    """Errors and consistency of each estimate."""
    table = _table(rows)
    headings = [heading for heading, *_ in _ERRORS]
    for heading in ("poses", *headings, "scale", "NEES/6\nmean", "NEES/6\ninside"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for row in rows:
        figures = row[2]
        cells = [str(figures["poses"])]
        for _, name, statistic, decimals in _ERRORS:
            cells.append(_number((figures[name] or {}).get(statistic), decimals))
        cells.append(_number(figures["scale"], 4))
        inside = figures.get("nees_inside")
        cells.append(_number(figures.get("nees_per_dof"), 2))
        cells.append("-" if inside is None else f"{100 * inside:.0f} %")
        table.add_row(*_names(rows, row), *cells)
    return table


def _stretch_table(rows: Sequence[Row]) -> Table:
    """Errors over stretches of each length: % of the length, and degrees a 100 m."""
    table = _table(rows)
    lengths = sorted(
        {round(each["length_m"], 1) for *_, figures in rows for each in figures["kitti_by_length"]}
    )
    for heading in (*(f"{length:g} m" for length in lengths), "all"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        of_length = {
            round(each["length_m"], 1): _stretch_text(each) for each in row[2]["kitti_by_length"]
        }
        cells = [of_length.get(length, "-") for length in lengths]
        table.add_row(*_names(rows, row), *cells, _stretch_text(row[2]["kitti"]))
    return table


def _stretch_text(figures: Mapping[str, float] | None) -> str:
    if not figures:
        return "-"
    return f"{figures['translation_percent']:.2f}\n{figures['rotation_deg_per_100m']:.2f}"


def _table(rows: Sequence[Row]) -> Table:
    """An empty table with columns for the estimates' names."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("run", "estimate")[not _has_several(rows) :]:
        table.add_column(heading)
    return table


def _names(rows: Sequence[Row], row: Row) -> Sequence[Text]:
    return [Text(one_line(name)) for name in row[:2][not _has_several(rows) :]]


def _has_several(rows: Sequence[Row]) -> bool:
    return len({name for name, *_ in rows}) > 1


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
