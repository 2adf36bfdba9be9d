# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Child processes: started with a log each, watched, and always ended.

One that takes long to import can be prepared before it is known what it is to do.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from vislam_ros.cli.child import WHEN_TOLD
from vislam_ros.cli.child_log import ChildLog
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.interrupts import held_interrupts
from vislam_ros.errors import VislamError

# What a child gets to end by itself before the next, less friendly signal.
_ENDING = ((signal.SIGINT, 1.0), (signal.SIGKILL, 3.0))
# One that has files to close, and then is the last one: see vislam_ros.nodes.spin.
_CLOSING = ((signal.SIGUSR1, 10.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


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
    log_folder : Path, optional
        Exists. Without it the process only gets ready, until :meth:`begin`.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        log_folder: Path | None = None,
    ):
        self.name = name
        self._asked = False
        self._log: ChildLog | None = None
        waits = [] if log_folder is not None else [WHEN_TOLD]
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "vislam_ros.cli.child", *waits, module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            start_new_session=True,
            bufsize=0,
        )
        self._environment = environment
        if log_folder is not None:
            self._open_log(log_folder)

    def begin(
        self, arguments: Sequence[str], environment: Mapping[str, str], log_folder: Path
    ) -> None:
        """Let a prepared process run, with more arguments and in this environment.

        Parameters
        ----------
        arguments : sequence of str
            Come after those it was prepared with.
        environment : mapping
            Variables of the one it was prepared with may have other values here.
        log_folder : Path
            Exists.
        """
        self._open_log(log_folder)
        own = self._environment
        changed = {name: value for name, value in environment.items() if own.get(name) != value}
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it is gone, as whoever watches it is going to see
            told = json.dumps({"arguments": list(arguments), "environment": changed})
            self._process.stdin.write(f"{told}\n".encode())

    @property
    def has_begun(self) -> bool:
        """Whether it runs, or did; one that is only prepared has done nothing yet."""
        return self._log is not None

    def _open_log(self, log_folder: Path) -> None:
        assert self._process.stdout is not None
        self._log = ChildLog(log_folder / f"{self.name}.log", self._process.stdout)

    @property
    def log(self) -> Path:
        """Where it is kept what it says."""
        assert self._log is not None
        return self._log.path

    @property
    def where(self) -> str:
        """Where what it says is kept, in brackets; empty where it has not begun."""
        return "" if self._log is None else f" ({self._log.path})"

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
        with suppress(ChildProcessError):  # it has ended meanwhile, and another thread was told
            return os.waitid(os.P_PID, self.pid, waiting) is not None
        return False

    def died(self) -> VislamError:
        """Return the error for a child that should still run."""
        code = self.exit_code
        how = f"exit code {code}"
        silent = "it was told to end" if code in (OK, INTERRUPTED) else "it named no error"
        error = self._last_error() or silent
        if code is not None and code < 0:
            how = f"signal {-code} ({signal.Signals(-code).name})"
            if -code == signal.SIGKILL:
                error += "; the system kills what takes too much memory"
        return VislamError(f"{self.name} ended early with {how}: {error}{self.where}")

    def _last_error(self) -> str | None:
        if self._log is not None:
            return self._log.last_error()
        assert self._process.stdout is not None
        return ChildLog(Path(os.devnull), self._process.stdout).last_error()

    def ask_to_end(self) -> None:
        """Send SIGINT, as Ctrl-C does, but only once, and let it go on if it was stopped."""
        if not self._asked:
            self._asked = True
            # In this order: of a stopped process any thread may take the interrupt, and the main
            # one sleep on.
            self.send(signal.SIGCONT)
            self.send(signal.SIGINT)

    def send(self, number: int) -> None:
        """Send a signal if it is still there."""
        if self.exit_code is None:
            self._process.send_signal(number)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for it, however long without a time (s); whether it ended."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """Keep what an ended child said last."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        if self._log is not None:
            self._log.close()
        elif self._process.stdout is not None:
            self._process.stdout.close()


@contextmanager
def prepared_children(modules: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Child]]:
    """Start children by name that only get ready; those that have not begun end with the block.

    Parameters
    ----------
    modules : mapping of str to sequence of str
        Module and first arguments of each.
    """
    children: dict[str, Child] = {}
    try:
        for name, (module, *arguments) in modules.items():
            with held_interrupts():
                children[name] = Child(name, module, arguments, os.environ)
        yield children
    finally:
        waiting = [child for child in children.values() if not child.has_begun]
        for child in waiting:
            child.send(signal.SIGKILL)  # it has nothing to lose
        for child in waiting:
            child.wait(_ENDING[-1][1])
            child.close()


class Children:
    """The children of a run, in the order in which they were started.

    Parameters
    ----------
    environment : mapping
    log_folder : Path
        Exists.
    prepared : mapping of str to Child, optional
        Those that are ready to begin, by name.
    """

    def __init__(
        self,
        environment: Mapping[str, str],
        log_folder: Path,
        prepared: Mapping[str, Child] | None = None,
    ):
        self._environment = environment
        self._log_folder = log_folder
        self._prepared = prepared or {}
        self._children: list[Child] = []

    def start(self, name: str, module: str, arguments: Sequence[str]) -> Child:
        """Start a child, or let the one begin that was prepared under this name."""
        with held_interrupts():  # a child that was started and is not known would never be ended
            child = self._prepared.get(name)
            if child is None:
                child = Child(name, module, arguments, self._environment, self._log_folder)
            else:
                child.begin(arguments, self._environment, self._log_folder)
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
