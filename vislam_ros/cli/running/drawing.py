# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of a run, drawn by a process that is ready when the results are."""

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.screen import waiting
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.errors import VislamError

_NAME, _MODULE = "pictures", "vislam_ros.cli.running.drawing"
_ERROR = "error: "
# Before the directories that are to be drawn.
_ALL = "--all"

#: What was drawn before the results were whole, and of which results.
_early: dict[Path, tuple[Results, dict[str, bytes]]] = {}


class Pictures:
    """Draws result directories in a process of its own, which may be started before.

    matplotlib takes a second to import.

    Parameters
    ----------
    scratch : Path
        Folder for what the process says.
    drive : str
        Its name where the results do not know it yet.
    wanted : bool
        Whether there are to be any.
    """

    def __init__(self, scratch: Path, drive: str, *, wanted: bool = True):
        self._wanted = wanted
        self._scratch = scratch
        self._drive = drive
        self._child: Child | None = None
        self._children: Children | None = None

    def prepare(self, directories: Sequence[Path]) -> None:
        """Start the process, which draws what needs no map of results that are all but whole."""
        if self._wanted and self._child is None:
            words = [self._drive, *map(str, directories)]
            self._child = Child(_NAME, _MODULE, words, os.environ)

    def begin(self, directories: Sequence[Path]) -> None:
        """Draw from now on, beside what this process does."""
        self.prepare([])
        if self._child is None:
            return
        self._children = Children(os.environ, self._scratch, {_NAME: self._child})
        words = [_ALL, *map(str, directories)]
        self._child = self._children.start(_NAME, _MODULE, words)

    def finish(self) -> None:
        """Wait until all is drawn; say of which there is no picture, and why."""
        child = self._child
        if child is None or not child.has_begun:
            return
        with waiting("drawing the pictures"):
            child.wait()
        log = child.log.read_text(errors="replace").splitlines()
        errors = [line.removeprefix(_ERROR) for line in log if line.startswith(_ERROR)]
        if not errors and child.exit_code != OK:
            errors = [str(child.died())]
        for error in errors:
            tell(f"warning: no picture: {error}")

    def close(self) -> None:
        """End the process, whatever it is at."""
        if self._children is not None:
            self._children.end()
        elif self._child is not None:
            self._child.send(signal.SIGKILL)
            self._child.wait()
            self._child.close()


def prepare(words: Sequence[str]) -> None:
    """Import what drawing needs, and draw what is known of the drive and its directories."""
    from vislam_ros.data.pictures.results import series_files

    drive, *directories = words
    for directory in map(Path, directories):
        with suppress(VislamError):  # it may be too early, and is tried again
            results = _read(directory, drive)
            _early[directory] = results, series_files(results, of_run=True)


def main() -> int:
    """Draw a drive, the first argument, of all result directories."""
    drive, *directories = sys.argv[1:]
    directories = directories[directories.index(_ALL) + 1 :]
    drawn = [_drawn(Path(directory), drive) for directory in directories]
    return OK if all(drawn) else FAILED


def _read(directory: Path, drive: str) -> Results:
    results = read_results(directory)
    named = {**results.summary, "drive": results.summary.get("drive") or drive}
    return replace(results, summary=named)


def _drawn(directory: Path, drive: str) -> bool:
    from vislam_ros.data.pictures.results import plot_results

    try:
        results = _read(directory, drive)
        early, files = _early.get(directory, (None, {}))
        drawn = files if early is not None and _look_the_same(early, results) else {}
        plot_results(results, force=True, of_run=True, drawn=drawn)
    except VislamError as error:
        tell(f"{_ERROR}{error}")
        return False
    return True


def _look_the_same(one: Results, other: Results) -> bool:
    """Whether pictures of the steps of these results are the same."""
    return (
        (one.name, one.summary.get("estimator")) == (other.name, other.summary.get("estimator"))
        and np.array_equal(one.trajectory.positions, other.trajectory.positions)
        and np.array_equal(one.trajectory.stamps, other.trajectory.stamps)
        and one.steps.keys() == other.steps.keys()
        and all(
            np.array_equal(values, other.steps[name], equal_nan=values.dtype.kind == "f")
            for name, values in one.steps.items()
        )
    )
