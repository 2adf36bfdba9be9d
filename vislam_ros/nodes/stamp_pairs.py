# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of values from two streams that carry the same stamp, whichever comes first."""

from collections import OrderedDict
from typing import Any

_LIMIT = 1000


class StampPairs:
    """Joins two streams, numbered 0 and 1, each of which keeps its own order.

    Attributes
    ----------
    unpaired : int
        Values that were given up: the other stream went past their stamp without one.
    """

    def __init__(self) -> None:
        self.unpaired = 0
        self._waiting: tuple[OrderedDict[int, Any], ...] = (OrderedDict(), OrderedDict())

    def add(self, stream: int, stamp: int, value: Any) -> tuple[Any, Any] | None:
        """Add a value of stream 0 or 1 at a stamp (ns); return the pair if it completes one."""
        own, other = self._waiting[stream], self._waiting[1 - stream]
        if stamp not in other:
            own[stamp] = value
            if len(own) > _LIMIT:
                own.popitem(last=False)
                self.unpaired += 1
            return None
        self.unpaired += len(own)
        own.clear()
        while True:
            waited, partner = other.popitem(last=False)
            if waited == stamp:
                return (partner, value) if stream else (value, partner)
            self.unpaired += 1
