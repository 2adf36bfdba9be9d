# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A benchmark's numbers as tables on a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

# Columns of text where there is no terminal to ask.
_FILE_WIDTH = 130

# Section -> title, and columns: key, heading, format.
_Columns = Sequence[tuple[str, str, str]]
_PEERS: _Columns = (
    ("name", "", "{}"),
    ("step_ms", "step [ms]", "{:.2f}"),
    ("step_ms_last_quarter", "last quarter [ms]", "{:.2f}"),
    ("times_ours", "times ours", "{:.1f}"),
    ("ate_online_m", "ATE online [m]", "{:.2f}"),
    ("ate_final_m", "ATE at the end [m]", "{:.2f}"),
    ("landmarks", "landmarks", "{}"),
    ("recipe", "landmarks: disparity", "{}"),
)
_TABLES: dict[str, tuple[str, _Columns]] = {
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
    "peers": ("On the same tracks, the whole drive", _PEERS),
    "peers_first_steps": ("On the same tracks, first steps: every peer", _PEERS),
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


def _table(title: str, columns: _Columns, rows: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(title=Text(title), title_justify="left")
    known = [column for column in columns if any(row.get(column[0]) is not None for row in rows)]
    for key, heading, _ in known:
        table.add_column(heading, justify="left" if key in ("name", "recipe") else "right")
    for row in rows:
        table.add_row(
            *(
                Text("" if row.get(key) is None else style.format(row[key]))
                for key, _, style in known
            )
        )
    return table
