# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Child processes: started with a log each, watched, and always ended."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from vislam_ros.cli.child_log import ChildLog
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.interrupts import held_interrupts
from vislam_ros.errors import VislamError

# What a child gets to end by itself before the next, less friendly signal.
_ENDING = ((signal.SIGINT, 1.0), (signal.SIGKILL, 3.0))
# One that has files to close.
_CLOSING = ((signal.SIGINT, 10.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


class Child:
    """A Python module that runs in a process and a session of its own.

    A Ctrl-C in the terminal does not reach it: its owner decides who ends when.

    Parameters
    ----------
    name : str
        For messages; the log is ``log_folder / f"{name}.log"``.
    module : str
        What ``python -m`` would run.
    arguments : sequence of str
    environment : mapping
    log_folder : Path
        Exists.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        log_folder: Path,
    ):
        self.name = name
        self.log = log_folder / f"{name}.log"
        self._asked = False
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "vislam_ros.cli.child", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self._log = ChildLog(self.log, self._process.stdout)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code, negative for the signal that ended it; None while it runs."""
        return self._process.poll()

    @property
    def is_stopped(self) -> bool:
        """Whether a signal has stopped it and none has made it go on."""
        if self.exit_code is not None:
            return False
        waiting = os.WSTOPPED | os.WNOHANG | os.WNOWAIT
        return os.waitid(os.P_PID, self.pid, waiting) is not None

    def died(self) -> VislamError:
        """Return the error for a child that should still run."""
        code = self.exit_code
        how = f"exit code {code}"
        silent = "it was told to end" if code in (OK, INTERRUPTED) else "it named no error"
        error = self._log.last_error() or silent
        if code is not None and code < 0:
            how = f"signal {-code} ({signal.Signals(-code).name})"
            if -code == signal.SIGKILL:
                error += "; the system kills what takes too much memory"
        return VislamError(f"{self.name} ended early with {how}: {error} ({self.log})")

    def ask_to_end(self) -> None:
        """Send SIGINT, as Ctrl-C does, but only once, and let it go on if it was stopped."""
        if not self._asked:
            self._asked = True
            self.send(signal.SIGINT)
            self.send(signal.SIGCONT)

    def send(self, number: int) -> None:
        """Send a signal if it is still there."""
        if self.exit_code is None:
            self._process.send_signal(number)

    def wait(self, seconds: float) -> bool:
        """Wait for it; whether it ended."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """Keep what an ended child said last."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._log.close()


class Children:
    """The children of a run, in the order in which they were started.

    Parameters
    ----------
    environment : mapping
    log_folder : Path
        Exists.
    """

    def __init__(self, environment: Mapping[str, str], log_folder: Path):
        self._environment = environment
        self._log_folder = log_folder
        self._children: list[Child] = []

    def start(self, name: str, module: str, arguments: Sequence[str]) -> Child:
        """Start a child."""
        with held_interrupts():  # a child that was started and is not known would never be ended
            child = Child(name, module, arguments, self._environment, self._log_folder)
            self._children.append(child)
        return child

    def send(self, number: int) -> None:
        """Send all of them a signal."""
        for child in self._children:
            child.send(number)

    def end(self, writer: Child | None = None) -> None:
        """End all of them together, in the friendliest way that works, and wait until they are.

        The one that writes down what the others send ends after them, so that nothing is lost.
        """
        if writer is not None:
            writer.send(signal.SIGCONT)
        _end([child for child in self._children if child is not writer], _ENDING)
        if writer is not None:
            _end([writer], _CLOSING)
        for child in self._children:
            child.close()


def _end(children: Sequence[Child], ending: Sequence[tuple[int, float]]) -> None:
    for number, patience in ending:
        for child in children:
            if number == signal.SIGINT:
                child.ask_to_end()
            else:
                child.send(number)
        end = time.monotonic() + patience
        if all(child.wait(max(0.0, end - time.monotonic())) for child in children):
            return
