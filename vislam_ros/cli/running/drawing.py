# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of a run, drawn by a process that is ready when the results are."""

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.processes import Child, Children
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
    """

    def __init__(self, scratch: Path):
        self._scratch = scratch
        self._child: Child | None = None

    def prepare(self) -> None:
        """Start the process, so that it is ready to draw."""
        if self._child is None:
            self._child = Child(_NAME, _MODULE, [], os.environ)

    def draw(self, directories: Sequence[Path]) -> None:
        """Draw; say of which there is no picture, and why."""
        self.prepare()
        prepared = {} if self._child is None else {_NAME: self._child}
        children = Children(os.environ, self._scratch, prepared)
        child = children.start(_NAME, _MODULE, [str(directory) for directory in directories])
        try:
            child.wait()
        finally:
            children.end()
        errors = [
            line.removeprefix(_ERROR)
            for line in child.log.read_text(errors="replace").splitlines()
            if line.startswith(_ERROR)
        ]
        if not errors and child.exit_code != OK:
            errors = [str(child.died())]
        for error in errors:
            tell(f"warning: no picture: {error}")

    def close(self) -> None:
        """End a process that has nothing to draw."""
        if self._child is not None and not self._child.has_begun:
            self._child.send(signal.SIGKILL)
            self._child.wait()
            self._child.close()


def prepare(_directories: Sequence[str]) -> None:
    """Import what drawing needs."""
    import vislam_ros.data.pictures.results  # noqa: F401


def main() -> int:
    """Draw the result directories that the arguments name."""
    drawn = [_drawn(Path(directory)) for directory in sys.argv[1:]]
    return OK if all(drawn) else FAILED


def _drawn(directory: Path) -> bool:
    from vislam_ros.data.pictures.results import plot_results

    try:
        plot_results(read_results(directory), force=True, of_run=True)
    except VislamError as error:
        tell(f"{_ERROR}{error}")
        return False
    return True
