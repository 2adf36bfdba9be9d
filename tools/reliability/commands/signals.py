# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signals to each process of a live run: what is lost, what is left, and how soon it ends.

tools/faults.py signals
tools/faults.py signals --signals TERM INT --targets recorder_node --rates 20 --moments 50
"""

import argparse
import dataclasses
import math
import random
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from reliability.output import add_output, write_output
from reliability.signals import RUN, SIGNALS, TARGETS, Outcome, Trial, measure, trials
from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.files.whole_file import refuse_existing
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

_NAMES = {number.name.removeprefix("SIG"): number for number in SIGNALS}
_OUT = Path("results") / "signals.json"
# Half a minute at 10 Hz: at rate 20 a second and a half, so that a signal strikes in the middle.
_DRIVE = SimulationSettings(steps=300, landmarks=1000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("--signals", nargs="+", choices=_NAMES, default=list(_NAMES), help="(all)")
    add("--targets", nargs="+", choices=TARGETS, default=list(TARGETS), help="(all)")
    add("--rates", nargs="+", type=float, default=[0.0, 20.0, 1.0], help="of the player (0 20 1)")
    add("--moments", type=int, default=10, help="signals of a kind at a rate (10)")
    add("--few", type=int, default=2, help="the same at rate 1, where a run takes long (2)")
    add_output(parser, _OUT)


def run_command(arguments: argparse.Namespace) -> int:
    """Run a simulated drive for each trial, and print what came of them."""
    refuse_existing(arguments.out, force=arguments.force)
    planned = [
        trial
        for trial in trials(arguments.rates, arguments.moments, arguments.few)
        if trial.number in [_NAMES[name] for name in arguments.signals]
        and trial.target in arguments.targets
    ]
    random.Random(0).shuffle(planned)  # so that a part of them tells of all
    outcomes: list[Outcome] = []
    try:
        _measure_all(planned, outcomes)
    finally:  # also after Ctrl-C
        write_output(arguments.out, [_as_dict(outcome) for outcome in outcomes])
        print_table(outcomes)
    return OK if all(outcome.holds for outcome in outcomes) else FAILED


def _measure_all(planned: Sequence[Trial], outcomes: list[Outcome]) -> None:
    with tempfile.TemporaryDirectory(prefix="vislam_faults_") as scratch:
        bag = Path(scratch) / "bag"
        write_bag(simulate(_DRIVE).drive, bag)
        for trial in planned:
            outcomes.append(measure(bag, _DRIVE.steps, Path(scratch) / "run", trial))
            print(f"{len(outcomes)} of {len(planned)}", end="\r", file=sys.stderr)
            if not outcomes[-1].holds:
                print(f"does not hold: {outcomes[-1]}", file=sys.stderr)


def print_table(outcomes: Sequence[Outcome]) -> None:
    """A line for each signal to each process."""
    print("| signal | to | runs | poses | lost | worst | s to the end | worst | left | hold |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for number in SIGNALS:
        for target in TARGETS:
            some = [o for o in outcomes if (o.trial.number, o.trial.target) == (number, target)]
            if not some:
                continue
            seconds = [o.ended_s for o in some if not math.isnan(o.ended_s)]
            times = "goes on | goes on"
            if seconds:
                times = f"{np.median(seconds):.2f} | {max(seconds):.2f}"
            print(
                f"| {number.name.removeprefix('SIG')} | {'`run`' if target == RUN else target} "
                f"| {len(some)} | {sum(o.heard for o in some)} | {sum(o.lost for o in some)} "
                f"| {max(o.lost for o in some)} | {times} | {sum(o.left for o in some)} "
                f"| {sum(o.holds for o in some)} |"
            )


def _as_dict(outcome: Outcome) -> dict[str, object]:
    trial = {
        **dataclasses.asdict(outcome.trial),
        "number": signal.Signals(outcome.trial.number).name,
    }
    ended_s = None if math.isnan(outcome.ended_s) else outcome.ended_s
    return {
        **dataclasses.asdict(outcome),
        "trial": trial,
        "ended_s": ended_s,
        "holds": outcome.holds,
    }
