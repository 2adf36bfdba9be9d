# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A watch over the processes of a run, from the first one's start to the end."""

import signal
import threading
from collections import Counter
from collections.abc import Iterable

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.processes import Child
from vislam_ros.cli.running.modules import PLAYER
from vislam_ros.errors import VislamError

_POLL_SECONDS = 0.02
# Long enough for a sampler that stops a process for a moment; the whole run ends within 2 s.
_STOPPED_SECONDS = 0.5


class Watch:
    """Looks at processes from a thread, so that none is missed while this one is busy.

    Until :meth:`settle` it interrupts the main thread, which imports and does not ask. Times are
    counted in looks, so that a run which was stopped as a whole goes on as if nothing had been.

    Parameters
    ----------
    children : iterable of Child
        The first ones.
    """

    def __init__(self, children: Iterable[Child]):
        self._children = list(children)
        self._stopped: Counter[str] = Counter()
        self._failed: Child | None = None
        self._interrupts = threading.Lock()  # held by whoever must not be interrupted any more
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._look_on, daemon=True)
        self._thread.start()

    def add(self, child: Child) -> None:
        """Watch one more, if it is not watched yet."""
        if child not in self._children:
            self._children.append(child)

    def settle(self) -> None:
        """Interrupt no more: from now on :meth:`check` is called often enough."""
        self._interrupts.acquire()

    def check(self) -> None:
        """Raise the VislamError of the first process that has ended early or stands still."""
        if self._failed is None:
            return
        if self._failed.exit_code is not None:
            raise self._failed.died()
        raise VislamError(
            f"{self._failed.name} was stopped by a signal and did not go on{self._failed.where}"
        )

    def close(self) -> None:
        """Look no more."""
        self._closing.set()
        self._thread.join()

    def _look_on(self) -> None:
        while self._failed is None and not self._closing.wait(_POLL_SECONDS):
            for child in tuple(self._children):
                if self._has_failed(child):
                    self._failed = child
                    self._interrupt()
                    return

    def _interrupt(self) -> None:
        main = threading.main_thread().ident
        if main is not None and self._interrupts.acquire(blocking=False):
            signal.pthread_kill(main, signal.SIGTERM)
            self._interrupts.release()

    def _has_failed(self, child: Child) -> bool:
        if child.exit_code is not None:
            return child.name != PLAYER or child.exit_code != OK
        self._stopped[child.name] = self._stopped[child.name] + 1 if child.is_stopped else 0
        return self._stopped[child.name] > _STOPPED_SECONDS / _POLL_SECONDS
