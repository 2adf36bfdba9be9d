# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Single keys from a terminal, which is left as it was found."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

SPACE = b" "
RIGHT_ARROW = b"\x1b[C"

_POLL_SECONDS = 0.1


@contextmanager
def watch_keys(actions: Mapping[bytes, Callable[[], None]]) -> Iterator[bool]:
    """Call an action for each key that is pressed, until the block ends.

    Yields whether keys are watched: they are where standard input is a terminal and this
    process is in its foreground (a background process would be stopped for touching it).
    Ctrl-C stays a signal.
    """
    terminal = _foreground_terminal()
    if terminal is None:
        yield False
        return
    before = termios.tcgetattr(terminal)
    ended = threading.Event()
    thread = threading.Thread(target=_watch, args=(terminal, actions, ended), daemon=True)
    try:
        tty.setcbreak(terminal)
        thread.start()
        yield True
    finally:
        ended.set()
        thread.join()
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _foreground_terminal() -> int | None:
    """File descriptor of standard input, where it is a terminal that listens to us."""
    try:
        terminal = sys.stdin.fileno()
        if os.isatty(terminal) and os.tcgetpgrp(terminal) == os.getpgrp():
            return terminal
    except (OSError, ValueError, AttributeError):
        pass
    return None


def _watch(
    terminal: int, actions: Mapping[bytes, Callable[[], None]], ended: threading.Event
) -> None:
    while not ended.is_set():
        ready, _, _ = select.select([terminal], [], [], _POLL_SECONDS)
        if not ready:
            continue
        typed = os.read(terminal, 64)
        if not typed:
            return
        for key, action in actions.items():
            for _ in range(typed.count(key)):
                action()
