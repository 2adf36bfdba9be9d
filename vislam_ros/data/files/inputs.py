# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are read: regular ones alone, and never more of one than its reader wants.

A FIFO waits for ever, a device has no end, and a file of text may be one line of terabytes. What
a file claims of itself is held against its size by whoever knows its format.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from vislam_ros.errors import VislamError

#: Settings, summaries and the like are some kilobytes [bytes].
LARGEST_TEXT = 1 << 20
# A line of numbers has some hundred characters [bytes].
_LONGEST_LINE = 1 << 16

_KINDS = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_regular(path: Path, what: str = "this file") -> None:
    """Refuse what is no regular file, or a link to one, before anybody opens it.

    Raises
    ------
    VislamError
        ``PATH: cannot read WHAT: REASON``.
    """
    with _clear_errors(path, what):
        _require_regular(path, what, path.stat().st_mode)


@contextmanager
def open_input(path: Path, what: str = "this file") -> Iterator[BinaryIO]:
    """Open a regular file to read its bytes; errors while it is open are named, too.

    Raises
    ------
    VislamError
        ``PATH: cannot read WHAT: REASON``.
    """
    check_regular(path, what)
    with _clear_errors(path, what):
        # It may have become a FIFO meanwhile, which would wait for a writer.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as file:
            _require_regular(path, what, os.fstat(handle).st_mode)
            yield file


def read_text(path: Path, what: str = "this file", largest: int = LARGEST_TEXT) -> str:
    """Read a small file of UTF-8 text, without the byte order mark that some editors begin with.

    Raises
    ------
    VislamError
        As :func:`open_input`, and where it is larger or no text.
    """
    with open_input(path, what) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise VislamError(f"{path}: cannot read {what}: it is larger than {largest >> 10} kB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise VislamError(f"{path}: cannot read {what}: it is not a text file") from error


def read_lines(path: Path, what: str = "this file") -> Iterator[tuple[int, str, bool]]:
    """Yield the lines of a file of UTF-8 text: number from 1, text, and whether it has its end.

    The byte order mark that some editors begin a file with is no part of its first line.

    Raises
    ------
    VislamError
        As :func:`open_input`, and where a line is no text or longer than any that is meant.
    """
    with open_input(path, what) as file:
        number = 0
        while line := file.readline(_LONGEST_LINE):
            number += 1
            if len(line) == _LONGEST_LINE:
                raise VislamError(
                    f"{path}: cannot read {what}: line {number} is longer than "
                    f"{_LONGEST_LINE >> 10} kB"
                )
            try:
                text = line.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError as error:
                raise VislamError(f"{path}: cannot read {what}: it is not a text file") from error
            yield number, text.rstrip("\r\n"), line.endswith(b"\n")


def _require_regular(path: Path, what: str, mode: int) -> None:
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "no regular file")
        raise VislamError(f"{path}: cannot read {what}: it is {kind}, not a file")


@contextmanager
def _clear_errors(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise VislamError(f"{path}: cannot read {what}: {error.strerror or error}") from error
    except ValueError as error:
        # A path may hold a NUL; what is read inside the block raises errors of its own.
        if "null" not in str(error):
            raise
        raise VislamError(f"{path}: cannot read {what}: no name holds a NUL") from error
