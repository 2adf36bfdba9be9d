# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Signals to each process of ``vislam run``, and what they cost.

A witness subscribes beside the recorder: what it has heard and ``trajectory.tum`` does not hold
was lost.
"""

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from reliability.witness import READY
from vislam_ros.cli.domain import own_domain
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.data.results.reader import read_results
from vislam_ros.errors import VislamError

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL, signal.SIGSTOP)
RUN = "run"
#: Processes by what they run.
TARGETS = {
    "imu_prediction_node": "vislam_ros.nodes.imu_prediction_node",
    "slam_node": "vislam_ros.nodes.slam_node",
    "recorder_node": "vislam_ros.nodes.recorder_node",
    "player": "play",
    RUN: "run",
}

_TOOLS = Path(__file__).resolve().parents[1]
_MARK = "VISLAM_FAULTS_RUN"
_WAIT = 120.0
_POLL = 0.002
# Of a run that was stopped itself: how long.
_STOP_SECONDS = 1.0
_ARRIVAL_SECONDS = 0.3
_SOON_SECONDS = 2.0


@dataclass(frozen=True)
class Trial:
    """A signal to a process at a moment.

    Attributes
    ----------
    number : signal.Signals
    target : str
        One of :data:`TARGETS`.
    rate : float
        Of the player.
    moment : float
        Share of the poses that are published by then; 0 while the nodes start.
    """

    number: signal.Signals
    target: str
    rate: float
    moment: float


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    Attributes
    ----------
    trial : Trial
    heard, lost : int
        Poses that the witness heard, and those of them that are not in ``trajectory.tum``.
    ended_s : float
        From the signal to the end of the run; NaN where it went on to its own end.
    left : int
        Processes that were left.
    code : int
        Exit code of the run.
    last_line : str
        What it said last on standard error.
    fault : str
        What is wrong with the results beside that they are incomplete; empty where nothing is.
    """

    trial: Trial
    heard: int
    lost: int
    ended_s: float
    left: int
    code: int
    last_line: str
    fault: str

    @property
    def is_named(self) -> bool:
        """Whether the run has told what happened, as far as it could."""
        if self.code == OK:
            return True
        if self.trial.target != RUN:
            return self.trial.target.split("_node")[0] in self.last_line
        if self.trial.number == signal.SIGKILL:
            return self.code == -signal.SIGKILL
        return self.code == INTERRUPTED and self.last_line.startswith("interrupted")

    @property
    def holds(self) -> bool:
        """Whether it is named, nothing is left or lost, and it ended soon enough.

        A recorder that is killed outright loses what it had not taken yet.
        """
        is_killed = (self.trial.target, self.trial.number) == ("recorder_node", signal.SIGKILL)
        in_time = not self.ended_s > _SOON_SECONDS
        whole = not self.fault and (is_killed or not self.lost)
        return self.is_named and whole and not self.left and in_time


def trials(rates: Sequence[float], moments: int, few: int) -> list[Trial]:
    """Each signal to each process, at so many moments of a rate, and at few in real time."""
    planned = []
    for number, target, rate in itertools.product(SIGNALS, TARGETS, rates):
        count = few if rate == 1.0 else moments
        planned += [
            # In real time a drive is long: early moments say as much as late ones.
            Trial(number, target, rate, k / count * (0.1 if rate == 1.0 else 1.0))
            for k in range(count)
        ]
    return planned


class Witness:
    """A process that hears what the recorder should."""

    def __init__(self, environment: dict[str, str]):
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "reliability.witness"],
            env={**environment, "PYTHONPATH": str(_TOOLS)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.stamps: list[int] = []
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip() == READY:
                self._ready.set()
            else:
                self.stamps.append(int(line))

    def wait_until_ready(self) -> None:
        """Wait until it listens."""
        if not self._ready.wait(_WAIT):
            raise VislamError("the witness did not start")

    def end(self) -> None:
        """Let it hear what is on its way, and go."""
        heard = -1
        while heard != len(self.stamps):
            heard = len(self.stamps)
            time.sleep(_ARRIVAL_SECONDS)
        self._process.communicate(timeout=_WAIT)
        self._thread.join()


class Run:
    """A ``vislam run`` whose processes can be told from all others by its directory."""

    def __init__(self, data: Path, out: Path, rate: float, environment: dict[str, str]):
        self.out = out
        command = ["run", str(data), "--out", str(out), f"--rate={rate}", "--force"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vislam_ros.cli.main", *command],
            env={**environment, _MARK: str(out)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def pids(self) -> dict[str, int]:
        """Pids of the processes that are alive, by their names in :data:`TARGETS`."""
        mark = f"{_MARK}={self.out}\0".encode()
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it may end meanwhile
                if mark in (folder / "environ").read_bytes():
                    words = (folder / "cmdline").read_bytes().decode().split("\0")
                    names = [name for name, word in TARGETS.items() if word in words]
                    found[names[0] if names else folder.name] = int(folder.name)
        return found


def measure(data: Path, frames: int, out: Path, trial: Trial) -> Outcome:
    """Run a drive of so many frames, and send the signal."""
    with own_domain() as domain:
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        witness = Witness(environment)
        witness.wait_until_ready()
        run = Run(data, out, trial.rate, environment)
        try:
            sent_at = _send(trial, run, witness, frames)
            _, errors = run.process.communicate(timeout=_WAIT)
            ended_s = time.monotonic() - sent_at
            left = _left_after_grace(run, trial)
        finally:
            for pid in run.pids().values():
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            witness.end()
    went_on = run.process.returncode == OK
    lines = errors.splitlines() or [""]
    lost = set(witness.stamps) - _recorded(out)
    return Outcome(
        trial=trial,
        heard=len(witness.stamps),
        lost=len(lost),
        ended_s=float("nan") if went_on else ended_s,
        left=left,
        code=run.process.returncode,
        last_line=lines[-1],
        fault=_fault(out, bool(witness.stamps)),
    )


def _send(trial: Trial, run: Run, witness: Witness, frames: int) -> float:
    """Send the signal at its moment; when that was."""
    end = time.monotonic() + _WAIT
    pid = None
    while time.monotonic() < end and run.process.poll() is None:
        if pid is None:
            pids = run.pids()
            # By then it runs its children.
            pid = pids.get(trial.target) if "player" in pids else None
        if pid and len(witness.stamps) >= trial.moment * frames:
            with suppress(ProcessLookupError):
                os.kill(pid, trial.number)
            break
        time.sleep(_POLL if pid else 0.02)
    sent_at = time.monotonic()
    if trial.target == RUN and trial.number == signal.SIGSTOP:
        time.sleep(_STOP_SECONDS)
        run.process.send_signal(signal.SIGCONT)
    return sent_at


def _left_after_grace(run: Run, trial: Trial) -> int:
    """Processes that are there when none should be; those of a killed run get 2 s."""
    grace = 2.0 if (trial.target, trial.number) == (RUN, signal.SIGKILL) else 0.0
    end = time.monotonic() + grace
    while run.pids() and time.monotonic() < end:
        time.sleep(0.02)
    return len(run.pids())


def _recorded(out: Path) -> set[int]:
    try:
        lines = (out / "trajectory.tum").read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        return set()
    return {round(int(word.replace(".", ""))) for word in (line.split()[0] for line in lines)}


def _fault(out: Path, has_poses: bool) -> str:
    """What hinders a reader of the results."""
    if not has_poses:
        return ""
    try:
        results = read_results(out)
        steps = json.loads((out / "summary.json").read_text(encoding="utf-8"))["steps"]
    except (VislamError, OSError, ValueError) as error:
        return str(error)
    if steps != len(results.trajectory):
        return f"summary.json says {steps} steps of {len(results.trajectory)}"
    return ""
