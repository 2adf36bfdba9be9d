# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM as a KeyboardInterrupt that arrives wherever it strikes, and a quick end."""

import _thread
import atexit
import functools
import gc
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# Python that numba's compiled functions call back. An exception that is raised there comes out as
# a SystemError.
_CALLED_BY_COMPILED_CODE = "numba.core.serialize"
_AGAIN_SECONDS = 0.005
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and what a service manager sends: both mean the same."""


def take_interrupts() -> None:
    """Prepare this process for Ctrl-C and SIGTERM, from now to its end.

    Where Ctrl-C is ignored, as in the background, it stays so.
    """
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = functools.partial(_not_raised, sys.unraisablehook)
    atexit.register(_end_quickly)


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Let an interrupt that comes in the block strike at its end: what it does is done whole."""
    caught: list[int] = []
    before = {
        number: signal.signal(number, lambda n, _: caught.append(n)) for number in INTERRUPTS
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for late in caught[:1]:
        signal.raise_signal(late)


def is_interrupt(error: BaseException | None) -> bool:
    """Tell whether an error is an interrupt, or what a class or a compiled call made of one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None


def _interrupt(_signal: int, frame: FrameType | None) -> None:
    if frame is not None and frame.f_globals.get("__name__") == _CALLED_BY_COMPILED_CODE:
        _try_again()
        return
    while frame is not None:
        if frame.f_code in (_not_raised.__code__, _try_again.__code__):
            _try_again()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _not_raised(
    otherwise: "Callable[[sys.UnraisableHookArgs], object]", unraisable: "sys.UnraisableHookArgs"
) -> None:
    """Take an exception that nobody can catch, as in a finalizer or a callback of C."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _try_again()
    else:
        otherwise(unraisable)


def _try_again() -> None:
    def interrupt() -> None:
        time.sleep(_AGAIN_SECONDS)
        main = threading.main_thread().ident
        if main is not None:
            # It also ends what is waited for, and is never ignored, as SIGINT may be.
            signal.pthread_kill(main, signal.SIGTERM)

    # Not a threading.Thread, whose start waits and would be interrupted in turn.
    _thread.start_new_thread(interrupt, ())


def _end_quickly() -> None:
    for number in INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # a collection frees nothing any more, and takes long with compiled code
