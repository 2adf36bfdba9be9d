# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Child processes: started with a log each, watched, and always ended."""

import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from vislam_ros.errors import VislamError

# What a child gets to end by itself before the next, less friendly signal.
_ENDING = ((signal.SIGINT, 10.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))
_LOG_TAIL_BYTES = 4096


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
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-m", "vislam_ros.cli.child", module, *arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=dict(environment),
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code, negative for the signal that ended it; None while it runs."""
        return self._process.poll()

    def last_line(self) -> str:
        """Last line of the log that says something."""
        with self.log.open("rb") as log:
            size = log.seek(0, 2)
            log.seek(max(0, size - _LOG_TAIL_BYTES))
            lines = log.read().decode("utf-8", "replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")

    def died(self) -> VislamError:
        """Return the error for a child that should still run."""
        code = self.exit_code
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return VislamError(f"{self.name} ended early with {how}: {self.last_line()} ({self.log})")

    def ask_to_end(self) -> None:
        """Send SIGINT, as Ctrl-C does, but only once."""
        if not self._asked:
            self._asked = True
            self._signal(signal.SIGINT)

    def end(self) -> None:
        """End it, in the friendliest way that works, and wait until it is gone."""
        for number, patience in _ENDING:
            if number == signal.SIGINT:
                self.ask_to_end()
            else:
                self._signal(number)
            try:
                self._process.wait(patience)
                break
            except subprocess.TimeoutExpired:
                continue
        if self._process.stdin is not None:
            self._process.stdin.close()

    def wait(self, seconds: float) -> bool:
        """Wait for it; whether it ended."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def _signal(self, number: int) -> None:
        if self.exit_code is None:
            self._process.send_signal(number)


class Children:
    """The children of a run, in the order in which they were started."""

    def __init__(self, environment: Mapping[str, str], log_folder: Path):
        self._environment = environment
        self._log_folder = log_folder
        self._children: list[Child] = []

    def start(self, name: str, module: str, arguments: Sequence[str]) -> Child:
        """Start a child."""
        child = Child(name, module, arguments, self._environment, self._log_folder)
        self._children.append(child)
        return child

    @property
    def last(self) -> Child:
        """The child that was started last."""
        return self._children[-1]

    def all_alive(self) -> bool:
        """Whether there are children and none has ended."""
        return bool(self._children) and all(child.exit_code is None for child in self._children)

    def end(self) -> None:
        """End all of them together, asking the last one first."""
        for child in reversed(self._children):
            child.ask_to_end()
        for child in reversed(self._children):
            child.end()
