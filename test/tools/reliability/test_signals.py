# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signals to the processes of a live run, with a witness beside the recorder."""

import dataclasses
import math
import signal
from pathlib import Path

import pytest
from reliability.signals import SIGNALS, TARGETS, Trial, measure, trials

from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

STEPS = 100


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("signals") / "bag"
    write_bag(simulate(SimulationSettings(steps=STEPS, landmarks=300)).drive, path)
    return path


def test_each_signal_goes_to_each_process_at_moments_of_the_drive() -> None:
    planned = trials([0.0, 1.0], moments=3, few=2)
    assert len(planned) == len(set(planned)) == len(SIGNALS) * len(TARGETS) * (3 + 2)
    assert {trial.moment for trial in planned if trial.rate == 0.0} == {0.0, 1 / 3, 2 / 3}


def test_no_pose_that_was_published_is_lost(bag: Path, tmp_path: Path) -> None:
    trial = Trial(signal.SIGTERM, "recorder_node", 10.0, 0.3)
    # Under load DDS has been seen not to find the witness in the whole of a run: it tells nothing.
    for _ in range(3):
        outcome = measure(bag, STEPS, tmp_path / "run", trial)
        if outcome.heard:
            break
    assert 0.3 * STEPS <= outcome.heard < STEPS
    assert (outcome.lost, outcome.left, outcome.fault) == (0, 0, "")
    assert outcome.is_named
    assert not math.isnan(outcome.ended_s)
    assert not dataclasses.replace(outcome, lost=1).holds
    assert not dataclasses.replace(outcome, left=1).holds
