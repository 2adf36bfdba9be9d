# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are either whole or not there: written beside their place, then renamed into it."""

from contextlib import suppress
from pathlib import Path

from vislam_ros.errors import OutputError, VislamError


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise a VislamError where ``path`` exists and may not be replaced."""
    if path.exists() and not force:
        raise VislamError(f"{path}: exists already: choose another output or add --force")


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader, or a kill at any moment, finds the old or the new one whole.

    Raises
    ------
    OutputError
        Where it cannot be written; nothing is left of the attempt.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot write this file: {error.strerror}") from error
