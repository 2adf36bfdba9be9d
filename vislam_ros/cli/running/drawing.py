# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of a run, drawn by a process that is ready when the results are."""

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.screen import waiting
from vislam_ros.data.results.reader import read_results
from vislam_ros.errors import VislamError

_NAME, _MODULE = "pictures", "vislam_ros.cli.running.drawing"
_ERROR = "error: "


class Pictures:
    """Draws result directories in a process of its own, which may be started before.

    matplotlib takes a second to import.

    Parameters
    ----------
    scratch : Path
        Folder for what the process says.
    drive : str
        Its name where the results do not know it yet.
    """

    def __init__(self, scratch: Path, drive: str):
        self._scratch = scratch
        self._drive = drive
        self._child: Child | None = None
        self._children: Children | None = None

    def prepare(self) -> None:
        """Start the process, so that it is ready to draw."""
        if self._child is None:
            self._child = Child(_NAME, _MODULE, [], os.environ)

    def begin(self, directories: Sequence[Path]) -> None:
        """Draw from now on, beside what this process does."""
        self.prepare()
        prepared = {} if self._child is None else {_NAME: self._child}
        self._children = Children(os.environ, self._scratch, prepared)
        words = [self._drive, *map(str, directories)]
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


def prepare(_words: Sequence[str]) -> None:
    """Import what drawing needs."""
    import vislam_ros.data.pictures.results  # noqa: F401


def main() -> int:
    """Draw a drive, the first argument, of the result directories that the others name."""
    drive, *directories = sys.argv[1:]
    drawn = [_drawn(Path(directory), drive) for directory in directories]
    return OK if all(drawn) else FAILED


def _drawn(directory: Path, drive: str) -> bool:
    from vislam_ros.data.pictures.results import plot_results

    try:
        results = read_results(directory)
        named = {**results.summary, "drive": results.summary.get("drive") or drive}
        plot_results(replace(results, summary=named), force=True, of_run=True)
    except VislamError as error:
        tell(f"{_ERROR}{error}")
        return False
    return True
