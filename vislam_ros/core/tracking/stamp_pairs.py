# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of values from two streams that carry the same stamp, whichever comes first."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

_LIMIT = 1000


class StampPairs:
    """Joins two streams, numbered 0 and 1, each of which keeps its own order.

    Parameters
    ----------
    on_unpaired : callable
        Called with the stream and the stamp (ns) of a value that is given up: the other stream
        went past its stamp without one.
    """

    def __init__(self, on_unpaired: Callable[[int, int], None]):
        self._on_unpaired = on_unpaired
        self._waiting: tuple[OrderedDict[int, Any], ...] = (OrderedDict(), OrderedDict())

    def is_left(self, stream: int) -> bool:
        """Whether a value of a stream waits, and the other stream has gone past its stamp."""
        own, other = self._waiting[stream], self._waiting[1 - stream]
        return bool(own and other) and next(iter(own)) < next(reversed(other))

    def add(self, stream: int, stamp: int, value: Any) -> tuple[Any, Any] | None:
        """Add a value of stream 0 or 1 at a stamp (ns); return the pair if it completes one."""
        own, other = self._waiting[stream], self._waiting[1 - stream]
        if stamp not in other:
            own[stamp] = value
            if len(own) > _LIMIT:
                self._give_up_first(stream)
            return None
        while own:
            self._give_up_first(stream)
        while True:
            waited, partner = other.popitem(last=False)
            if waited == stamp:
                return (partner, value) if stream else (value, partner)
            self._on_unpaired(1 - stream, waited)

    def _give_up_first(self, stream: int) -> None:
        stamp, _ = self._waiting[stream].popitem(last=False)
        self._on_unpaired(stream, stamp)
