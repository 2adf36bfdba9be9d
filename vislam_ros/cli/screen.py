# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a user sees: progress bars on a terminal, and tables."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from vislam_ros.core.filters.quantities import OF_ROBOCENTRIC
from vislam_ros.data.results.estimate_rows import estimate_rows
from vislam_ros.errors import one_line

_SUMMARY_ROWS = (
    ("estimator", "estimator", "{}"),
    ("steps", "steps", "{}"),
    ("frozen_steps", "frozen steps", "{}"),
    ("landmarks", "landmarks", "{}"),
    ("tracks", "tracks", "{}"),
    ("observations", "observations", "{}"),
    ("left_out", "left out by max_active", "{}"),
    ("rejected_fraction", "rejected", "{:.2%}"),
    ("nis_per_dof", "NIS per degree of freedom", "{:.2f}"),
    ("estimates", "", ""),
    ("wall_s", "first to last step [s]", "{:.2f}"),
    ("total_s", "whole command [s]", "{:.2f}"),
    ("realtime_factor", "times real time", "{:.1f}"),
    ("step_ms_p50", "step, median [ms]", "{:.2f}"),
    ("step_ms_p99", "step, 99 % [ms]", "{:.2f}"),
    ("latency_ms_p99", "latency, 99 % [ms]", "{:.2f}"),
    ("peak_rss_mb", "peak memory [MB]", "{:.0f}"),
    ("resets", "resets", "{}"),
    ("refused", "refused messages", "{}"),
    ("complete", "complete", "{}"),
)

_FILE_WIDTH = 200  # characters, where no terminal says how wide it is


def table_console() -> Console:
    """Standard output for wide tables: no line is folded in a file or a pipe."""
    console = Console()
    return console if console.is_terminal else Console(width=_FILE_WIDTH)


@contextmanager
def progress_bar(
    description: str, total: float, detail: str = ""
) -> Iterator[Callable[[float, str], None]]:
    """Show a bar on a terminal, and nothing elsewhere; yields ``update(done, detail)``.

    The bar is on standard error, so that standard output holds results only.
    """
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[detail]}"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(description, total=total or None, detail=detail)
        yield lambda done, detail: progress.update(task, completed=done, detail=detail)


def print_table(title: str, rows: Mapping[str, str]) -> None:
    """Print names and values."""
    table = Table(title=Text(one_line(title)), title_justify="left", show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for name, value in rows.items():
        table.add_row(Text(name), Text(one_line(value)))
    Console().print(table)


def print_summary(title: str, summary: Mapping[str, Any]) -> None:
    """Print what ``summary.json`` says, without what is not known."""
    rows = {}
    for key, label, style in _SUMMARY_ROWS:
        value = summary.get(key)
        if value is None or value == {} or (key == "left_out" and not value):
            continue
        if key == "estimates":
            rows.update(estimate_rows(value, OF_ROBOCENTRIC))
            continue
        if key == "refused":
            value = ", ".join(f"{count} {reason}" for reason, count in value.items())
        elif isinstance(value, bool):
            value = "yes" if value else "no"
        rows[label] = style.format(value)
    print_table(title, rows)


@contextmanager
def waiting(text: str) -> Iterator[None]:
    """Say on a terminal, on standard error, what is waited for; nothing elsewhere."""
    console = Console(stderr=True)
    with console.status(text) if console.is_terminal else nullcontext():
        yield
