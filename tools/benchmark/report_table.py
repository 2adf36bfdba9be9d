# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A benchmark's numbers as tables on a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

# Columns of text where there is no terminal to ask.
_FILE_WIDTH = 150

#: Columns of a table: key, heading, format.
Columns = Sequence[tuple[str, str, str]]

BATTERY_ROWS: Columns = (
    ("name", "", "{}"),
    ("dead_reckoning_percent", "dead reckoning [%]", "{:.2f}"),
    ("estimate_percent", "estimate [%]", "{:.2f}"),
    ("to_dead_reckoning", "ratio", "{:.2f}"),
    ("beside_percent", "the other [%]", "{:.2f}"),
    ("to_beside", "ratio", "{:.2f}"),
    ("smoothed_percent", "smoothed [%]", "{:.2f}"),
    ("estimate_ate_m", "ATE [m]", "{:.2f}"),
    ("estimate_nees", "NEES/6", "{:.1f}"),
    ("gyro_bias_max", "largest bias [rad/s]", "{:.4f}"),
    ("worse", "worse", "{}"),
)
BATTERY_GROUPS: Columns = (
    ("name", "", "{}"),
    ("rows", "rows", "{}"),
    ("worse", "worse", "{}"),
    ("failed", "failed trials", "{}"),
    ("to_dead_reckoning", "estimate / dead reckoning", "{:.3f}"),
    ("smoothed_to_dead_reckoning", "smoothed / dead reckoning", "{:.3f}"),
    ("to_beside", "estimate / the other", "{:.3f}"),
    ("smoothed_to_beside", "smoothed / the other", "{:.3f}"),
)
#: One mechanism that is switched off, by groups of the battery's rows.
ABLATION: Columns = (
    ("name", "without", "{}"),
    ("whole drives", "whole", "{:.3f}"),
    ("quarters", "quarters", "{:.3f}"),
    ("clean twist", "clean", "{:.3f}"),
    ("sliding tracks", "sliding", "{:.3f}"),
    ("simulated drives", "drives", "{:.3f}"),
    ("simulated walks", "walks", "{:.3f}"),
    ("simulated flights", "flights", "{:.3f}"),
    ("gyroscope alone", "gyroscope", "{:.3f}"),
    ("images", "images", "{:.3f}"),
    ("all", "all", "{:.3f}"),
    ("worse", "worse rows", "{}"),
)

_PEERS: Columns = (
    ("name", "", "{}"),
    ("step_ms", "step [ms]", "{:.2f}"),
    ("step_ms_last_quarter", "last quarter [ms]", "{:.2f}"),
    ("times_ours", "times ours", "{:.1f}"),
    ("ate_online_m", "ATE online [m]", "{:.2f}"),
    ("ate_final_m", "ATE at the end [m]", "{:.2f}"),
    ("landmarks", "landmarks", "{}"),
    ("recipe", "landmarks: disparity", "{}"),
)
# Section -> title and columns.
_TABLES: dict[str, tuple[str, Columns]] = {
    "floor": (
        "The step above the LAPACK floor (potrf, trsm, syrk)",
        (
            ("active", "active", "{}"),
            ("new_each_step", "new a step", "{}"),
            ("rows", "rows", "{}"),
            ("state", "state", "{}"),
            ("step_ms", "step [ms]", "{:.2f}"),
            ("filter_ms", "filter alone [ms]", "{:.2f}"),
            ("floor_ms", "floor [ms]", "{:.2f}"),
            ("ratio", "step / floor", "{:.2f}"),
            ("motion_ms", "F P F^T [ms]", "{:.2f}"),
        ),
    ),
    "dense": (
        "Beside the dense filter over all M landmarks",
        (
            ("landmarks", "M", "{}"),
            ("active", "seen a step", "{}"),
            ("dense_ms", "dense [ms]", "{:.1f}"),
            ("step_ms", "step [ms]", "{:.2f}"),
            ("ratio", "dense / step", "{:.0f}"),
        ),
    ),
    "map_growth": (
        "Growth with the map, the view being the same",
        (
            ("landmarks", "M at the start", "{}"),
            ("landmarks_at_the_end", "at the end", "{}"),
            ("active", "active", "{}"),
            ("step_ms", "step [ms]", "{:.2f}"),
            ("ratio", "to the first", "{:.2f}"),
        ),
    ),
    "view_growth": (
        "Growth with the view, a thirteenth of it new each step",
        (
            ("active", "active", "{}"),
            ("step_ms", "step [ms]", "{:.2f}"),
            ("floor_ms", "floor [ms]", "{:.2f}"),
            ("ratio", "step / floor", "{:.2f}"),
        ),
    ),
    "drives": (
        "A whole drive",
        (
            ("name", "", "{}"),
            ("steps", "steps", "{}"),
            ("landmarks", "landmarks", "{}"),
            ("wall_s", "wall [s]", "{:.1f}"),
            ("cpu_s", "CPU [s]", "{:.1f}"),
            ("peak_rss_mb", "peak memory [MB]", "{:.0f}"),
            ("step_ms_p50", "step p50 [ms]", "{:.2f}"),
            ("step_ms_p99", "p99 [ms]", "{:.2f}"),
            ("ate_m", "ATE [m]", "{:.2f}"),
            ("ate_smoothed_m", "smoothed [m]", "{:.2f}"),
        ),
    ),
    "consistency": (
        "Consistency and optimality on simulated drives, means over the seeds",
        (
            ("velocity_noise_std", "twist noise [m/s]", "{:g}"),
            ("angular_velocity_noise_std", "[rad/s]", "{:g}"),
            ("frozen_share", "frozen", "{:.0%}"),
            ("name", "", "{}"),
            ("nees", "NEES/6", "{:.2f}"),
            ("nees_std_error", "+-", "{:.2f}"),
            ("ate_m", "ATE [m]", "{:.3f}"),
            ("batch_m", "batch [m]", "{:.3f}"),
            ("to_batch", "ratio", "{:.2f}"),
            ("batch_with_walk_m", "batch with walk [m]", "{:.3f}"),
            ("to_batch_with_walk", "ratio", "{:.2f}"),
            ("dead_reckoning_m", "dead reckoning [m]", "{:.2f}"),
        ),
    ),
    "tracks": (
        "Errors of the disparities of tracks",
        (
            ("from_px", "disparity from [px]", "{:g}"),
            ("to_px", "to [px]", "{:g}"),
            ("tracks", "tracks", "{}"),
            ("first_px", "in the first frame [px]", "{:.2f}"),
            ("step_px", "change in a frame [px]", "{:.2f}"),
            ("later_px", "in five [px]", "{:.2f}"),
        ),
    ),
    "redrawn": (
        "Consistency on the drive with its noise drawn anew, means over the seeds",
        (
            ("name", "", "{}"),
            ("drives", "drives", "{}"),
            ("nees", "NEES/6", "{:.2f}"),
            ("nees_std_error", "+-", "{:.2f}"),
            ("nees_least", "least", "{:.2f}"),
            ("nees_greatest", "greatest", "{:.2f}"),
            ("ate_m", "ATE [m]", "{:.2f}"),
            ("ate_least_m", "least", "{:.2f}"),
            ("ate_greatest_m", "greatest", "{:.2f}"),
        ),
    ),
    "frontend": (
        "The front end: images to tracks; the floor is OpenCV's calls of the usual recipe",
        (
            ("name", "", "{}"),
            ("size", "pixels", "{}"),
            ("features", "points", "{}"),
            ("observations", "seen a frame", "{}"),
            ("length", "frames a track", "{:.1f}"),
            ("noise_px", "noise stated [px]", "{:.3f}"),
            ("whitened", "residual / noise", "{:.2f}"),
            ("beyond", "beyond 1 in 1000", "{:.1%}"),
            ("frame_ms", "frame [ms]", "{:.1f}"),
            ("floor_ms", "floor [ms]", "{:.1f}"),
            ("ratio", "frame / floor", "{:.2f}"),
        ),
    ),
    "frontend_stages": (
        "Stages of the front end",
        (
            ("images", "", "{}"),
            ("name", "", "{}"),
            ("frame_ms", "a frame [ms]", "{:.2f}"),
            ("share", "share", "{:.0%}"),
        ),
    ),
    "peers": ("On the same tracks, the whole drive", _PEERS),
    "peers_first_steps": ("On the same tracks, first steps: every peer", _PEERS),
    "battery": ("The battery: errors per cent of the path, means over the seeds", BATTERY_ROWS),
    "battery_groups": ("Groups of the battery, geometric means of ratios", BATTERY_GROUPS),
    "ablation": ("Error without each mechanism over that with it, geometric means", ABLATION),
}


def print_report(report: Mapping[str, Any]) -> None:
    """Print every section that a report has, and what it was measured on."""
    console = Console()
    if not console.is_terminal:
        console.width = _FILE_WIDTH
    machine = report["machine"]
    console.print(
        Text(
            f"{machine['cpu']}, {machine['usable_cores']} cores, load {machine['load_1min']:.1f}; "
            f"Python {machine['python']}, numpy {machine['numpy']}, scipy {machine['scipy']}, "
            f"gtsam {machine['gtsam'] or 'not installed'}; {'; '.join(machine['blas'])}"
        )
    )
    console.print(Text(f"estimator {report['estimator']}; {report['clock']}"))
    for section, (title, columns) in _TABLES.items():
        if section in report:
            content = report[section]
            rows = content["runs"] if isinstance(content, Mapping) else content
            if isinstance(content, Mapping) and "steps" in content:
                title = f"{title}, {content['steps']} steps"
            console.print(_table(title, columns, rows))
    for note in report["notes"]:
        console.print(Text(f"note: {note}"))


def known_columns(columns: Columns, rows: Sequence[Mapping[str, Any]]) -> Columns:
    """Return the columns that any row can fill."""
    return [column for column in columns if any(row.get(column[0]) is not None for row in rows)]


def cells(columns: Columns, row: Mapping[str, Any]) -> list[str]:
    """Return the text of each column; nothing for what is not known and what is not so."""
    return [_text(row.get(key), form) for key, _, form in columns]


def _text(value: Any, form: str) -> str:
    if value is None or value is False:
        return ""
    return "yes" if value is True else form.format(value)


def _table(title: str, columns: Columns, rows: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(title=Text(title), title_justify="left")
    known = known_columns(columns, rows)
    for key, heading, _ in known:
        table.add_column(Text(heading), justify="left" if key in ("name", "recipe") else "right")
    for row in rows:
        table.add_row(*map(Text, cells(known, row)))
    return table
