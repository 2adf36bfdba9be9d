# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which pass of a live run a verdict is on."""

from pathlib import Path

import numpy as np
import pytest
from step_rows import step_row

from vislam_ros.core.verdict.reason import Judgement, Word
from vislam_ros.data.bags.layout import ODOMETRY, STEPS
from vislam_ros.data.results.recording import Pose, Raw, Recording
from vislam_ros.data.results.summary import read_summary

STAMPS = [k * 100_000_000 for k in range(1, 6)]
BAD = ("one", "two")


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return Recording(tmp_path / "run", force=False, record_mcap=False)


def add_steps(recording: Recording, stamps: list[int]) -> None:
    for stamp in stamps:
        pose = Pose(
            stamp,
            np.zeros(3),
            np.array([0.0, 0.0, 0.0, 1.0]),
            Raw(ODOMETRY, b""),
            "map",
            "base_link",
        )
        row = step_row(stamp, first_of_pass=stamp in (STAMPS[0], STAMPS[0] + 1))
        recording.add_step(pose, np.eye(6), row, Raw(STEPS, b""), latency_ms=1.0)


def verdict_in(directory: Path) -> tuple[str | None, list[str]]:
    summary = read_summary(directory / "summary.json")
    return summary["verdict"], summary["verdict_reasons"]


def test_each_pass_has_the_verdict_on_its_own_steps(recording: Recording, tmp_path: Path) -> None:
    first = Judgement(STAMPS[-1] + 1, Word.DOUBTFUL, BAD)
    add_steps(recording, [stamp + 1 for stamp in STAMPS])
    recording.set_verdict(Judgement(STAMPS[2] + 1, Word.GOOD, ()))
    add_steps(recording, STAMPS[:1])
    # Of the pass before and of this one, as a report has them.
    recording.set_verdict(first)
    recording.set_verdict(Judgement(STAMPS[0], Word.GOOD, ()))
    add_steps(recording, STAMPS[1:])
    recording.set_verdict(first)
    recording.set_verdict(Judgement(STAMPS[-1], Word.CONTRADICTION, BAD[:1]))
    recording.finish(complete=True)
    assert verdict_in(tmp_path / "run") == ("doubtful", list(BAD))
    assert verdict_in(tmp_path / "run" / "pass_002") == ("contradiction", ["one"])


def test_a_verdict_on_all_steps_gives_way_to_no_other(
    recording: Recording, tmp_path: Path
) -> None:
    add_steps(recording, STAMPS)
    recording.flush()
    assert verdict_in(tmp_path / "run") == (None, [])
    recording.set_verdict(Judgement(STAMPS[-1], Word.DOUBTFUL, BAD))
    # Of a pass that is yet to be heard of.
    recording.set_verdict(Judgement(STAMPS[0], Word.GOOD, ()))
    recording.flush()
    assert verdict_in(tmp_path / "run") == ("doubtful", list(BAD))
