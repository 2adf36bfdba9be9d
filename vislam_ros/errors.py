# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors that a user can mend: one line that names the file, the field, the value and the cure."""

import os
from typing import TypeVar

_LONGEST_LINE = 1000

T = TypeVar("T")


class VislamError(Exception):
    """A known error. The command line prints its message as one line and exits with 1."""


class SettingsError(VislamError, ValueError):
    """A setting that does not exist, has the wrong type or lies outside its range."""


class OutputError(VislamError):
    """A file cannot be written, now or later: nothing that goes on can mend it."""


def of_type(what: str, value: T, kind: type | tuple[type, ...], wanted: str) -> T:
    """Give an argument back, or raise a VislamError that says what is wanted in its place."""
    if not isinstance(value, kind):
        raise VislamError(f"{what} is of type {type(value).__name__}: give {wanted}")
    return value


def path_like(what: str, value: T) -> T:
    """Give the path of a file back, or raise a VislamError where it is none."""
    return of_type(what, value, (str, os.PathLike), "the path of a file, as text or Path")


def one_line(text: str) -> str:
    r"""Text as one line of printable characters: what is neither is written as an escape.

    Names and contents of files come into messages, and may hold line ends, a terminal's own
    commands, or bytes that are no text: each shows as ``\n``, ``\x1b`` or ``\udcff``. Of a text
    that is longer than any message need be the middle is left out.
    """
    if len(text) > _LONGEST_LINE:
        half = _LONGEST_LINE // 2
        text = f"{text[:half]} [...] {text[-half:]}"
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode("ascii")
        for char in text
    )


def reason_of(error: BaseException) -> str:
    """What an error says, in one line, whatever it is: ours, the system's or a fault of ours."""
    if isinstance(error, VislamError):
        return one_line(str(error))
    if isinstance(error, MemoryError):
        return "not enough memory: the input is too large for this machine or its limits"
    if isinstance(error, RecursionError):
        return "the input is nested too deeply"
    if isinstance(error, OSError) and error.strerror:
        names = [str(name) for name in (error.filename, error.filename2) if name is not None]
        return one_line(
            ": ".join([" and ".join(names), error.strerror] if names else [error.strerror])
        )
    if isinstance(error, UnicodeError):
        return one_line(f"cannot be read or written as text: {error}")
    what = " ".join(str(error).split())
    return one_line(
        f"internal error: {type(error).__name__}{': ' if what else ''}{what} (-v shows where)"
    )
