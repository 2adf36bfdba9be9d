# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of time: when a stamp is late, when it is there twice, and when time begins anew.

The one rule, live and offline:

- A stamp that lies more than ``time_jump`` before the newest of its stream begins a new pass,
  as when a bag loops. Passes of streams that travel together are numbered alike, so that the
  features of a pass meet the motion of the same pass; a stream that joins later joins the pass
  that the others are in.
- Within a pass what counts is the order of the stamps. Offline each stream is sorted, so nothing
  is late. Live, what comes after a newer stamp is refused as late, even if its frame might still
  have waited: whether it did would depend on how fast the other stream happened to be.
- Of two messages with one stamp the first to come is used.

So live and offline agree to the last message wherever messages come in the order of their stamps.
"""

from collections.abc import Mapping

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, Stream


class TimeOrder:
    """Watches one stream's stamps.

    Parameters
    ----------
    time_jump : float
        Seconds that a stamp must lie back to begin a new pass and not to be late.
    """

    def __init__(self, time_jump: float):
        self._time_jump = round(time_jump * 1e9)
        self._newest: int | None = None

    def place(self, stamp: int) -> bool:
        """Take a stamp (ns) in whatever order; tell whether a new pass begins with it."""
        jumps = self._newest is not None and stamp < self._newest - self._time_jump
        if jumps or self._newest is None or stamp > self._newest:
            self._newest = stamp
        return jumps

    def enter(self, stamp: int) -> bool:
        """Take a stamp (ns) that comes now; tell whether a new pass begins with it.

        Raises
        ------
        RefusedMessage
            Where it is not newer than those before it in its pass.
        """
        newest = self._newest
        jumps = self.place(stamp)
        if newest is not None and stamp <= newest and not jumps:
            raise RefusedMessage(Refusal.DUPLICATE if stamp == newest else Refusal.LATE)
        return jumps


class Passes:
    """Numbers the passes of streams that travel together, from 0.

    Parameters
    ----------
    time_jumps : mapping of Stream to float
        ``time_jump`` of each stream.
    """

    def __init__(self, time_jumps: Mapping[Stream, float]):
        self._orders = {stream: TimeOrder(seconds) for stream, seconds in time_jumps.items()}
        self._numbers: dict[Stream, int] = {}

    def number(self, stream: Stream) -> int:
        """Pass that a stream is in, or would join."""
        return self._numbers.get(stream, max(self._numbers.values(), default=0))

    def place(self, stream: Stream, stamp: int) -> int:
        """Take a stamp (ns) in whatever order; return the number of its pass."""
        return self._count(stream, self._orders[stream].place(stamp))

    def enter(self, stream: Stream, stamp: int) -> int:
        """Take a stamp (ns) that comes now; return the number of its pass.

        Raises
        ------
        RefusedMessage
            Where it is not newer than those before it in its pass.
        """
        return self._count(stream, self._orders[stream].enter(stamp))

    def _count(self, stream: Stream, jumps: bool) -> int:
        self._numbers[stream] = self.number(stream) + jumps
        return self._numbers[stream]
