# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a child process says: kept in a file as it comes, and of it the last error by itself."""

import re
import threading
from contextlib import suppress
from pathlib import Path
from typing import IO

# A node's logger, a command's own line, and what Python, C++ and the C library say at the end.
_ERROR = re.compile(
    r"\[(?:ERROR|FATAL)\] \[[\d.]+\] \[[^]]*\]: (?P<logged>.*)"
    r"|error: (?P<told>.*)"
    r"|(?P<plain>(?:Fatal Python error: |terminate called |  what\(\):  ).*)"
)
_TRACEBACK = "Traceback (most recent call last):"
_ENDING_SECONDS = 1.0


class ChildLog:
    """Copies a pipe into a file, from a thread.

    The child never notices that the disk is full, and its last words are known all the same.

    Parameters
    ----------
    path : Path
    pipe : binary file
    """

    def __init__(self, path: Path, pipe: IO[bytes]):
        self.path = path
        self._pipe = pipe
        self._error: str | None = None
        self._file = path.open("wb", buffering=0)
        self._thread = threading.Thread(target=self._copy, daemon=True)
        self._thread.start()

    def last_error(self) -> str | None:
        """Last error of a child that has ended, in one line; None where it named none."""
        self.close()
        return self._error

    def close(self) -> None:
        """Take the rest of what an ended child has said."""
        self._thread.join(_ENDING_SECONDS)

    def _copy(self) -> None:
        in_traceback = False
        with self._pipe, self._file:
            for line in self._pipe:
                with suppress(OSError):
                    self._file.write(line)
                text = line.decode("utf-8", "replace").rstrip()
                if in_traceback and text and not text.startswith(" "):
                    self._error, in_traceback = text, False
                elif text == _TRACEBACK:
                    in_traceback = True
                elif found := _ERROR.match(text):
                    self._error = next(words for words in found.groups() if words).strip()
