# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whatever ends a command is one line, and no traceback unless it is asked for."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from vislam_ros.cli.commands import verify
from vislam_ros.cli.exit_codes import PIPE_CLOSED
from vislam_ros.cli.main import main
from vislam_ros.errors import VislamError, one_line, reason_of


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (VislamError("a.npz: first\nsecond"), ["a.npz: first\\nsecond"]),
        (RecursionError("maximum recursion depth exceeded"), ["nested too deeply"]),
        (MemoryError(), ["not enough memory"]),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "a.npz"), ["a.npz", "open files"]),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), ["No space left"]),
        (OverflowError(34, "Numerical result out of range"), ["OverflowError", "-v"]),
        (KeyError("a\nb"), ["internal error", "KeyError", "-v"]),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), ["as text"]),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_error_of_any_kind_is_one_line(
    error: Exception, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    def fail(_arguments: object) -> int:
        raise error

    monkeypatch.setattr(verify, "run", fail)
    assert main(["verify", "bag"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert line.isprintable()
    for word in words:
        assert word in line
    assert main(["verify", "bag", "-v"]) == 1
    text = capsys.readouterr().err
    assert text.startswith("Traceback")
    assert text.splitlines()[-1] == line


def test_names_show_their_escapes() -> None:
    name = os.fsdecode(b"a\n\x1b[31m\xff\r\x07")
    assert one_line(name) == r"a\n\x1b[31m\udcff\r\x07"
    assert one_line("ä 3 m/s²") == "ä 3 m/s²"


@pytest.mark.parametrize(("length", "is_cut"), [(1000, False), (1001, True)])
def test_the_middle_of_a_long_line_is_left_out(length: int, is_cut: bool) -> None:
    line = one_line("a" * length)
    assert ("[...]" in line) is is_cut
    assert len(line) < 1010


def test_an_error_of_two_files_names_both() -> None:
    error = OSError(errno.EXDEV, "Invalid link", "a", None, "b")
    assert reason_of(error) == "a and b: Invalid link"


@pytest.mark.parametrize("argv", [["--help"], ["verify", "--help"]])
def test_a_reader_that_leaves_is_no_error(argv: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    result = subprocess.run(
        [sys.executable, "-m", "vislam_ros.cli.main", *argv],
        stdout=writing,
        stderr=subprocess.PIPE,
        timeout=60,
        check=False,
    )
    os.close(writing)
    assert result.stderr == b""


def test_a_reader_that_leaves_in_the_middle_ends_a_command_quietly(
    monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    def leave(_arguments: object) -> int:
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    monkeypatch.setattr(verify, "run", leave)
    assert main(["verify", "bag"]) == PIPE_CLOSED
    assert capfd.readouterr().err == ""


def test_pythons_warnings_are_no_lines_of_a_command(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    def warn(arguments: Any) -> int:
        import warnings

        warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)
        return 0

    monkeypatch.setattr(verify, "run", warn)
    monkeypatch.setattr(sys, "warnoptions", [])
    assert main(["verify", str(Path("bag"))]) == 0
    assert not recwarn
