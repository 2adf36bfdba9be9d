# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The end of a recording that is told to end while the graph may go on.

What was published before is written. Steps that come after are held, until slam_node has said as
of which step its map is: with that step the recording ends, so that poses and map are of one time.
"""

from typing import Generic, TypeVar

QUIET_SECONDS = 0.2
"""How long nothing must have come before a recorder closes its files where no map is to come."""

LINGERING_SECONDS = 1.0
"""How long it waits for that; after it, one moment is enough at which nothing waits."""

_LONGEST_SECONDS = 5.0

T = TypeVar("T")


class Ending(Generic[T]):
    """Begins when the recorder is told to end.

    Parameters
    ----------
    now : float
        Monotonic seconds.
    inputs : int
        Messages that came so far.

    Attributes
    ----------
    last : int or None
        Stamp (ns) of the last step, once it is known.
    """

    def __init__(self, now: float, inputs: int):
        self._inputs, self._since, self._changed_at = inputs, now, now
        self._held: list[tuple[int, T]] = []
        self.last: int | None = None
        self._is_over = self._is_quiet = False

    def note_empty(self, now: float, inputs: int, *, more_may_come: bool) -> None:
        """Note that nothing waits to be taken, and whether anybody is left who may send.

        Only such a moment tells that nothing came: a recorder that had no time to look has not
        taken anything either.
        """
        if inputs != self._inputs:
            self._inputs, self._changed_at = inputs, now
        lingered = now - self._since > LINGERING_SECONDS
        nothing_came = now - self._changed_at >= QUIET_SECONDS
        self._is_quiet = not more_may_come or lingered or nothing_came

    def is_quiet(self, now: float) -> bool:
        """Whether nothing is on its way any more, as far as that can be told."""
        return self._is_quiet or now - self._since > _LONGEST_SECONDS

    @property
    def is_missed(self) -> bool:
        """Whether the last step is not to come: it is not here, and nothing is on its way.

        So it is where slam_node had it before the recorder began.
        """
        return self.last is not None and not self._is_over and self._is_quiet

    def take(self, stamp: int, step: T) -> list[T]:
        """Take a step (ns); return those that are to be written now."""
        self._held.append((stamp, step))
        return [] if self.last is None else self._release()

    def end_at(self, stamp: int, written: int | None, now: float) -> list[T]:
        """End with the step of a stamp (ns), given the last one written; return others to write.

        That step is written already, or among those that are held, or comes soon.
        """
        if self.last is not None:
            return []
        self.last = stamp
        self._since, self._changed_at, self._is_quiet = now, now, False
        self._is_over = stamp == written
        return self._release()

    def end_here(self) -> list[T]:
        """End with the newest step; return those that are to be written still."""
        held, self._held = self._held, []
        return [] if self._is_over else [step for _, step in held]

    def _release(self) -> list[T]:
        held, self._held = self._held, []
        released: list[T] = []
        for stamp, step in held:
            if not self._is_over:
                released.append(step)
                self._is_over = stamp == self.last
        return released
