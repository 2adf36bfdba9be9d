# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are either whole or not there: written beside their place, then renamed into it."""

from pathlib import Path

from vislam_ros.errors import VislamError


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise a VislamError where ``path`` exists and may not be replaced."""
    if path.exists() and not force:
        raise VislamError(f"{path}: exists already: choose another output or add --force")


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader, or a kill at any moment, finds the old or the new one whole.

    Raises
    ------
    VislamError
        Where it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        raise VislamError(f"{path}: cannot write this file: {error.strerror}") from error
