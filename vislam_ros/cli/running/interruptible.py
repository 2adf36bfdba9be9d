# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An interrupt whose ending nothing interrupts."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from vislam_ros.cli.interrupts import INTERRUPTS


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C or SIGTERM interrupt the block once: the ending is not to be interrupted."""

    def interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
        ignore_interrupts()
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ignore_interrupts() -> None:
    """Let no signal of these disturb what follows."""
    for number in INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)
