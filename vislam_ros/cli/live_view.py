# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``run`` shows in a terminal while it goes on: two lines; nothing elsewhere."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from vislam_ros.cli.ending import PassResults
from vislam_ros.data.results.growing import GrowingResults, GrowingStep
from vislam_ros.data.results.summary import has_ended
from vislam_ros.errors import one_line

if TYPE_CHECKING:
    from vislam_ros.data.viewing.live import LiveViewer

#: Told the steps so far, the newest summary and the newest step, where there is one.
Update = Callable[[int, Mapping[str, Any], GrowingStep | None], None]

_RATE_SECONDS = 2.0


class StepRate:
    """How many steps a second come, over the last two seconds."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()

    def add(self, now: float, steps: int) -> None:
        """Take the number of steps so far at a time, seconds."""
        while len(self._seen) > 1 and now - self._seen[1][0] >= _RATE_SECONDS:
            self._seen.popleft()
        self._seen.append((now, steps))

    @property
    def per_second(self) -> float | None:
        """The rate; None before there are two times."""
        (first, before), (last, steps) = self._seen[0], self._seen[-1]
        return (steps - before) / (last - first) if last > first else None


def status_lines(
    summary: Mapping[str, Any], step: GrowingStep | None, rate: float | None
) -> tuple[str, str]:
    """Rate, latency and counts in one line; position with its deviation and verdict in another.

    Parameters
    ----------
    summary : mapping
        ``summary.json`` as it stands.
    step : GrowingStep or None
        The newest.
    rate : float or None
        Steps a second.
    """
    first = [] if rate is None else [f"{rate:.0f} steps/s"]
    if summary.get("latency_ms_p50") is not None:
        first.append(
            f"latency {summary['latency_ms_p50']:.1f} ms (99 %: {summary['latency_ms_p99']:.1f})"
        )
    if step is not None:
        first.append(f"{step.row['active']:.0f} active, {step.row['rejected']:.0f} rejected")
        if summary.get("rejected_fraction") is not None:
            first[-1] += f" ({summary['rejected_fraction']:.1%} of all)"
    second = []
    if step is not None:
        # The largest deviation of any direction, whatever the axes.
        std = np.sqrt(max(float(np.linalg.eigvalsh(step.covariance[:3, :3])[-1]), 0.0))
        place = ", ".join(f"{value:.1f}" for value in step.position)
        second.append(f"at {place} m ± {std:.2g} m")
    if summary.get("verdict"):
        reasons = "; ".join(summary.get("verdict_reasons", []))
        second.append(f"{summary['verdict']} so far" + (f": {reasons}" if reasons else ""))
    return ", ".join(first), ", ".join(second)


class RunView:
    """Shows a run from what its recorder has written so far, on a terminal and in a viewer.

    Parameters
    ----------
    update : callable
        Of the terminal, see :func:`live_view`.
    viewer : LiveViewer, optional
    """

    def __init__(self, update: Update, viewer: "LiveViewer | None" = None):
        self._update = update
        self._viewer = viewer
        self._growing: GrowingResults | None = None
        self._newest: GrowingStep | None = None
        self._count = 0

    def show(self, passes: Sequence[PassResults]) -> None:
        """Show the passes so far, each with its directory and its summary; the last one grows."""
        directory, summary = passes[-1]
        if self._growing is None or self._growing.directory != directory:
            if self._growing is not None and self._viewer is not None:
                self._viewer.begin_pass()
            self._growing = GrowingResults(directory)
        steps = self._growing.new_steps()
        self._newest = steps[-1] if steps else self._newest
        if self._viewer is not None:
            self._viewer.add(directory, steps)
            if has_ended(summary):
                self._viewer.renew(directory)
        # The rows are ahead of the summaries, which come once a second.
        self._count = max(self._count + len(steps), sum(each["steps"] for _, each in passes))
        self._update(self._count, summary, self._newest)


@contextmanager
def opened_viewer(name: str, *, wanted: bool) -> Iterator["LiveViewer | None"]:
    """Open a viewer for a run; None where none is wanted.

    Raises
    ------
    VislamError
        Where it is not installed, or there is no screen for it.
    """
    if not wanted:
        yield None
        return
    # It is slow to import, and need not be installed.
    from vislam_ros.data.viewing.live import LiveViewer
    from vislam_ros.data.viewing.stream import opened_stream

    with opened_stream(name) as stream:
        yield LiveViewer(stream)


@contextmanager
def live_view(total: int) -> Iterator[Update]:
    """Show a bar and two lines on a terminal, on standard error, and nothing elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda steps, summary, step: None
        return
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=console,
    )
    task = progress.add_task("running", total=total or None)
    texts = (Text(no_wrap=True, overflow="ellipsis"), Text(no_wrap=True, overflow="ellipsis"))
    rate = StepRate()

    def update(steps: int, summary: Mapping[str, Any], step: GrowingStep | None) -> None:
        rate.add(time.monotonic(), steps)
        progress.update(task, completed=steps)
        for text, line in zip(texts, status_lines(summary, step, rate.per_second), strict=True):
            text.plain = f"  {one_line(line)}"

    with Live(Group(progress, *texts), console=console, transient=True, refresh_per_second=5):
        yield update
