# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of time: which stamps are believed, which are late, and when time begins anew.

The one rule, live and offline, for each stream by itself:

- A stamp is beside another where it lies no more than ``time_jump`` from it, or ahead of it by no
  more than twice the usual step of its stream, where that is longer.
- What is beside the newest stamp continues the stream. What is not is held: it is believed as
  soon as a message comes that is beside it, and refused where one continues the stream or is
  beside another that is held. What would be late but is the usual step after one that is held
  is beside that one. So the first message of all is believed with the second, and what
  nothing follows up until the end is refused.
- A believed stamp ahead is the end of a hole, and what was held before it in its order was in the
  hole. One back begins a new pass, as when a bag loops. Passes of streams that travel together
  are numbered alike, so that the features of a pass meet the motion of the same pass; a stream
  that joins later joins the pass that the others are in.
- Within a pass what counts is the order of the stamps. Offline each stream is sorted, so nothing
  is late. Live, what comes after a newer stamp is refused as late, even if its frame might still
  have waited: whether it did would depend on how fast the other stream happened to be. For the
  same reason no stream is asked about the stamps of another.
- Of two messages with one stamp the first to come is used.

So a bad stamp costs its own message and nothing else, and live and offline agree to the last
message wherever messages come in the order of their stamps.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, Stream

T = TypeVar("T")

# More than a stream with some bad stamps holds; one without any order must not fill the memory.
_MOST_HELD = 8


@dataclass(frozen=True)
class Believed(Generic[T]):
    """A message whose stamp is believed.

    Attributes
    ----------
    stamp : int
        Nanoseconds.
    message : T
    begins_pass : bool
        Whether time begins anew with it; not so for the first of all.
    """

    stamp: int
    message: T
    begins_pass: bool = False


class TimeOrder(Generic[T]):
    """Watches one stream's stamps, and holds what is not believed yet.

    Parameters
    ----------
    time_jump : float
        Seconds that a stamp may lie from the newest one and continue the stream.
    refuse : callable
        Called with the reason and the stamp (ns) of each message that is not to be used.
    sorts : bool, optional
        Whether what is late is used all the same, for whoever sorts.
    """

    def __init__(
        self, time_jump: float, refuse: Callable[[Refusal, int], object], *, sorts: bool = False
    ):
        self._time_jump = round(time_jump * 1e9)
        self._refuse = refuse
        self._sorts = sorts
        self._newest: int | None = None
        self._step = 0  # the usual one [ns]; 0 where it is not known
        self._held: list[Believed[T]] = []

    @property
    def held(self) -> list[int]:
        """Stamps (ns) of the messages that are not believed yet, as they came."""
        return [message.stamp for message in self._held]

    def enter(self, stamp: int, message: T) -> list[Believed[T]]:
        """Take a message that comes now; return those that are believed with it, in order."""
        came = Believed(stamp, message)
        if stamp == self._newest or stamp in self.held:
            self._refuse(Refusal.DUPLICATE, stamp)
            return []
        if self._continues(stamp):
            self._refuse_held()
            return self._continue(came)
        for place in reversed(range(len(self._held))):
            if self._is_beside(stamp, self._held[place].stamp, self._step_to(place)):
                return [*self._believe(place, stamp), *self._continue(came)]
        self._held.append(came)
        if len(self._held) > _MOST_HELD:
            self._refuse(Refusal.BAD_STAMP, self._held.pop(0).stamp)
        return []

    def end(self) -> None:
        """Refuse what is held: nothing more is to come."""
        self._refuse_held()

    def _continues(self, stamp: int) -> bool:
        if self._newest is None or not self._is_beside(stamp, self._newest, self._step):
            return False
        # A pass may be hardly longer than the jump back to its begin.
        is_next = any(0 < stamp - held <= 2 * self._step for held in self.held)
        return stamp > self._newest or not is_next

    def _is_beside(self, stamp: int, other: int, step: int) -> bool:
        return -self._time_jump <= stamp - other <= max(self._time_jump, 2 * step)

    def _step_to(self, place: int) -> int:
        """Usual step, or, where none is known, the one to a message that is held."""
        if self._step or not place:
            return self._step
        return self._held[place].stamp - self._held[place - 1].stamp

    def _believe(self, place: int, follower: int) -> list[Believed[T]]:
        """Believe a message that is held, for the sake of the one that comes beside it."""
        begin, newest = self._held[place], self._newest
        begins_pass = newest is not None and begin.stamp < newest
        believed = [Believed(begin.stamp, begin.message, begins_pass)]
        for message in reversed(self._held[:place]):
            if newest is None:  # the stream may be as slow as that
                step = follower - begin.stamp
                fits = self._is_beside(believed[0].stamp, message.stamp, step)
            else:
                fits = newest < message.stamp < believed[0].stamp
            if fits and message.stamp < believed[0].stamp:
                believed.insert(0, message)
        kept = {message.stamp for message in believed}
        self._held = [message for message in self._held if message.stamp not in kept]
        self._refuse_held()
        self._newest, self._step = begin.stamp, 0
        return believed

    def _continue(self, came: Believed[T]) -> list[Believed[T]]:
        """Take a message that is beside the newest one."""
        assert self._newest is not None
        if came.stamp > self._newest:
            self._step, self._newest = came.stamp - self._newest, came.stamp
        elif not self._sorts:
            self._refuse(Refusal.LATE, came.stamp)
            return []
        return [came]

    def _refuse_held(self) -> None:
        for message in self._held:
            self._refuse(Refusal.BAD_STAMP, message.stamp)
        self._held.clear()


class Passes:
    """Numbers the passes of streams that travel together, from 0.

    Parameters
    ----------
    time_jumps : mapping of Stream to float
        ``time_jump`` of each stream.
    refuse : callable
        Called with stream, reason and stamp (ns) of each message that is not to be used.
    sorts : bool, optional
        As of a :class:`TimeOrder`.
    """

    def __init__(
        self,
        time_jumps: Mapping[Stream, float],
        refuse: Callable[[Stream, Refusal, int], object],
        *,
        sorts: bool = False,
    ):
        self._orders: dict[Stream, TimeOrder[Any]] = {
            stream: TimeOrder(seconds, functools.partial(refuse, stream), sorts=sorts)
            for stream, seconds in time_jumps.items()
        }
        self._numbers: dict[Stream, int] = {}

    def number(self, stream: Stream) -> int:
        """Pass that a stream is in, or would join."""
        return self._numbers.get(stream, max(self._numbers.values(), default=0))

    def has_begun(self, stream: Stream) -> bool:
        """Whether a stream has had a message that is believed."""
        return stream in self._numbers

    def enter(self, stream: Stream, stamp: int, message: T) -> list[tuple[int, int, T]]:
        """Take a message that comes now.

        Returns
        -------
        list of (int, int, T)
            Number of the pass, stamp (ns) and message of each that is believed with it, in order.
        """
        entered = []
        for believed in self._orders[stream].enter(stamp, message):
            self._numbers[stream] = self.number(stream) + believed.begins_pass
            entered.append((self._numbers[stream], believed.stamp, believed.message))
        return entered

    def held(self, stream: Stream) -> list[int]:
        """Stamps (ns) of a stream's messages that are not believed yet."""
        return self._orders[stream].held

    def refused_if_over(self) -> RefusalCounts:
        """Messages that will be refused if nothing more comes: those that are held."""
        over = RefusalCounts()
        for stream, order in self._orders.items():
            for stamp in order.held:
                over.add(stream, Refusal.BAD_STAMP, stamp)
        return over

    def end(self) -> None:
        """Refuse what is held: nothing more is to come."""
        for order in self._orders.values():
            order.end()
