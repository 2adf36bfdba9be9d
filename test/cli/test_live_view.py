# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from step_rows import step_row

from vislam_ros.cli import live_view as module
from vislam_ros.cli.live_view import RunView, StepRate, live_view, status_lines
from vislam_ros.data.results.growing import GrowingStep
from vislam_ros.data.results.summary import read_summary
from vislam_ros.data.results.writer import ResultWriter

IDENTITY = [0.0, 0.0, 0.0, 1.0]


def step(**changes: float) -> GrowingStep:
    covariance = np.diag([0.01, 0.09, 0.04, 1.0, 1.0, 1.0])
    row = step_row(10**9, **changes)
    return GrowingStep(10**9, np.array([12.34, -5.0, 0.2]), np.array(IDENTITY), covariance, row)


def test_lines_hold_rate_latency_landmarks_position_with_sigma_and_verdict() -> None:
    summary = {
        "latency_ms_p50": 2.14,
        "latency_ms_p99": 6.0,
        "rejected_fraction": 0.012,
        "verdict": "doubtful",
        "verdict_reasons": ["too few tracks"],
    }
    first, second = status_lines(summary, step(active=62, rejected=3), 19.6)
    assert first == ("20 steps/s, latency 2.1 ms (99 %: 6.0), 62 active, 3 rejected (1.2% of all)")
    assert second == "at 12.3, -5.0, 0.2 m ± 0.3 m, doubtful so far: too few tracks"


def test_what_is_not_known_yet_is_left_out() -> None:
    assert status_lines({}, None, None) == ("", "")
    assert status_lines({"verdict": "good"}, None, 5.0) == ("5 steps/s", "good so far")


def test_the_rate_is_that_of_the_last_two_seconds() -> None:
    rate = StepRate()
    rate.add(100.0, 50)
    assert rate.per_second is None
    for k in range(1, 11):
        rate.add(100.0 + k, 50 + 10 * k)
    assert rate.per_second == pytest.approx(10.0)
    for k in range(1, 4):
        rate.add(110.0 + k, 150 + 30 * k)
    assert rate.per_second == pytest.approx(30.0)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    screen = io.StringIO()
    monkeypatch.setattr(
        module,
        "Console",
        lambda **_: Console(file=screen, force_terminal=True, width=100, height=20),
    )
    return screen


def test_a_terminal_shows_both_lines(terminal: io.StringIO) -> None:
    with live_view(100) as update:
        update(37, {"verdict": "good"}, step(active=62))
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.getvalue())
    assert "running" in text
    assert "37%" in text
    assert "62 active" in text
    assert "at 12.3, -5.0, 0.2 m ± 0.3 m, good so far" in text


def test_it_is_quiet_where_there_is_no_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with live_view(100) as update:
        update(37, {"verdict": "good"}, step())
    assert capfd.readouterr() == ("", "")


class Viewer:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.told: list[Any] = []

    def add(self, directory: Path, steps: list[GrowingStep]) -> None:
        if steps:
            self.told.append((directory.name, len(steps)))

    def renew(self, directory: Path) -> None:
        self.told.append(f"renew {directory.name}")

    def begin_pass(self) -> None:
        self.told.append("another pass")


def test_the_newest_pass_is_shown_as_it_grows(tmp_path: Path) -> None:
    counts, newest = [], []
    viewer = Viewer()

    def update(steps: int, _: Any, last: GrowingStep | None) -> None:
        counts.append(steps)
        newest.append(None if last is None else last.stamp)

    view = RunView(update, viewer)  # type: ignore[arg-type]
    first, second = tmp_path / "results", tmp_path / "results" / "pass_002"

    def passes(*directories: Path) -> list[Any]:
        return [(each, read_summary(each / "summary.json")) for each in directories]

    with ResultWriter(first) as writer:
        view.show(passes(first))
        for stamp in (10**9, 2 * 10**9):
            writer.add_step([0.0] * 3, IDENTITY, np.eye(6), step_row(stamp))
        view.show(passes(first))
        writer.finish(complete=True)
    with ResultWriter(second) as writer:
        writer.add_step([0.0] * 3, IDENTITY, np.eye(6), step_row(10**9))
        writer.finish(complete=True)
    view.show(passes(first, second))
    assert counts == [0, 2, 3]
    assert newest == [None, 2 * 10**9, 10**9]
    assert viewer.told == [("results", 2), "another pass", ("pass_002", 1), "renew pass_002"]
