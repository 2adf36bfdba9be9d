# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a message of a bag is due: a rate, pauses, single steps and the end, between threads."""

import threading
import time
from collections.abc import Callable

_LONGEST_WAIT = 0.5
# While it plays, the clock is looked at at least every second: after such a gap it was stopped.
_STOPPED_SECONDS = 2.0


class PlaybackClock:
    """Bag time against wall time.

    The schedule is absolute, ``wall = wall_0 + (stamp - stamp_0) / rate``, so late messages do
    not make later ones late. Only a pause, a step, a new pass or a stop of the process, as by
    Ctrl-Z, moves its origin. Every wait is on one condition, so that a pause, a step and the end
    act at once.

    Parameters
    ----------
    rate : float
        Bag seconds in a wall second; 0 makes every message due at once.
    paused : bool
        Whether the clock begins paused.
    now : callable
        Monotonic wall time, seconds.
    """

    def __init__(
        self, rate: float, *, paused: bool = False, now: Callable[[], float] = time.monotonic
    ):
        self.rate = rate
        self.condition = threading.Condition()
        self.interrupted = False
        self._now = now
        self._paused = paused
        self._steps = 0
        self._stamp_0 = 0
        self._wall_0 = self._paused_at = self._seen = now()
        self._idle = 0.0

    @property
    def paused(self) -> bool:
        """Whether messages wait until :meth:`resume` or :meth:`step`."""
        return self._paused

    def start(self, stamp: int) -> None:
        """Make ``stamp`` (ns) due now: a pass begins."""
        with self.condition:
            self._set(stamp)

    def position(self) -> int:
        """Bag time of now, nanoseconds."""
        with self.condition:
            if self._paused:
                return self._stamp_0
            return self._stamp_0 + int((self._look() - self._wall_0) * self.rate * 1e9)

    def pause(self) -> None:
        """Hold every message that is not sent yet."""
        with self.condition:
            if not self._paused:
                self._set(self.position())
                self._paused, self._paused_at = True, self._wall_0
                self.condition.notify_all()

    def resume(self) -> None:
        """Go on where the pause or the last step stopped."""
        with self.condition:
            self._idle += self._pause_so_far()
            self._paused = False
            self._steps = 0
            self._wall_0 = self._seen = self._now()
            self.condition.notify_all()

    def seconds_paused(self) -> float:
        """Wall time spent in pauses up to now."""
        with self.condition:
            return self._idle + self._pause_so_far()

    def toggle(self) -> None:
        """Pause or resume."""
        with self.condition:
            if self._paused:
                self.resume()
            else:
                self.pause()

    def step(self) -> None:
        """Pause, and let messages through until one more step is over."""
        with self.condition:
            self.pause()
            self._steps += 1
            self.condition.notify_all()

    def interrupt(self) -> None:
        """End every wait, now and later."""
        with self.condition:
            self.interrupted = True
            self.condition.notify_all()

    def wait(self, stamp: int) -> bool:
        """Wait until ``stamp`` (ns) is due; False where the playing was interrupted."""
        with self.condition:
            while not self.interrupted:
                if self._paused:
                    if self._steps:
                        return True
                    self.condition.wait(_LONGEST_WAIT)
                    continue
                if self.rate == 0.0:
                    return True
                now = self._look()
                due = self._wall_0 + (stamp - self._stamp_0) * 1e-9 / self.rate
                remaining = due - now
                if remaining <= 0.0:
                    return True
                self.condition.wait(min(remaining, _LONGEST_WAIT))
            return False

    def sent(self, stamp: int, *, ends_step: bool) -> None:
        """Note that the message with this stamp is sent; it may end a step."""
        with self.condition:
            if self.rate == 0.0 or self._paused:
                self._stamp_0 = stamp
            if self._steps and ends_step:
                self._steps -= 1

    def wait_for(self, met: Callable[[], bool], seconds: float, poll: float = 0.02) -> bool:
        """Wait until ``met()`` or the time is over or the playing was interrupted.

        The condition is looked at each time that it is notified and every ``poll`` seconds.
        """
        end = self._now() + seconds
        with self.condition:
            while not met():
                remaining = end - self._now()
                if remaining <= 0.0 or self.interrupted:
                    return False
                self.condition.wait(min(poll, remaining))
            return True

    def _pause_so_far(self) -> float:
        return self._now() - self._paused_at if self._paused else 0.0

    def _look(self) -> float:
        """Wall time; the time in which the process stood still is no time of the playing."""
        now = self._now()
        if now - self._seen > _STOPPED_SECONDS:
            self._wall_0 += now - self._seen
            self._idle += now - self._seen
        self._seen = now
        return now

    def _set(self, stamp: int) -> None:
        self._stamp_0 = stamp
        self._wall_0 = self._seen = self._now()
