# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Keys from a terminal, which is left as it was found."""

import os
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from places import REPOSITORY

from vislam_ros.nodes.player.keys import watch_keys

WAIT = 30

# The first terminal that a session opens is its own; it says each key that it hears.
PROGRAM = """\
import os, sys, threading
terminal = os.open(sys.argv[1], os.O_RDWR)
os.dup2(terminal, 0)
from vislam_ros.nodes.player.keys import RIGHT_ARROW, SPACE, watch_keys
done = threading.Event()
def right():
    print("right", flush=True)
    done.set()
try:
    with watch_keys({SPACE: lambda: print("space", flush=True), RIGHT_ARROW: right}) as watched:
        print("watched" if watched else "not watched", flush=True)
        assert done.wait(20)
        raise ZeroDivisionError
except ZeroDivisionError:
    print("left", flush=True)
"""


def test_keys_are_heard_and_the_terminal_is_restored_after_an_error() -> None:
    controller, terminal = os.openpty()
    before = termios.tcgetattr(terminal)
    child = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, os.ttyname(terminal)],
        cwd=REPOSITORY,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert child.stdout.readline() == "watched\n"
        assert not termios.tcgetattr(terminal)[3] & termios.ICANON
        os.write(controller, b"x \x1b[C")
        output, _ = child.communicate(timeout=WAIT)
        assert output.split() == ["space", "right", "left"]
        assert termios.tcgetattr(terminal) == before
    finally:
        child.kill()
        child.wait(WAIT)
        os.close(controller)
        os.close(terminal)


def test_without_a_terminal_nothing_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with watch_keys({}) as watched:
            assert not watched


@pytest.mark.parametrize("stdin", [None, object()])
def test_a_strange_standard_input_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, stdin: object | None
) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    with watch_keys({}) as watched:
        assert not watched
