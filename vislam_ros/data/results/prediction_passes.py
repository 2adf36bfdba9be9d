# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Predicted poses by the pass of a recording to which each belongs.

A pass ends where time jumps back, which the predictions tell themselves, or where the estimate was
reset, which only the next step tells. So what is ahead of the steps waits for the next one.
"""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from vislam_ros.core.settings import MotionSettings
from vislam_ros.core.tracking.time_order import TimeOrder

# Poses that may be ahead: ten seconds of a gyroscope at 1000 Hz.
_MOST_AHEAD = 10_000

T = TypeVar("T")


class PredictionPasses(Generic[T]):
    """Holds predictions until it is known where they belong.

    Attributes
    ----------
    time_pass : int
        How often time has jumped back in the predictions.
    """

    def __init__(self) -> None:
        self.time_pass = 0
        self._held: deque[tuple[int, int, T]] = deque()  # time pass, stamp, pose
        # slam_node tells of those that it refused for their stamp.
        self._order: TimeOrder[T] = TimeOrder(MotionSettings().time_jump, lambda *_: None)

    def enter(self, stamp: int, pose: T) -> None:
        """Take a pose with its stamp (ns)."""
        for believed in self._order.enter(stamp, pose):
            self.time_pass += believed.begins_pass
            self._held.append((self.time_pass, believed.stamp, believed.message))

    def take(self, time_pass: int, until: float) -> Iterator[tuple[int, int, T]]:
        """Take out the poses up to a stamp (ns) in a time pass.

        What is held of it for too long comes, too: steps may have ceased.

        Yields
        ------
        (int, int, T)
            Time pass, stamp (ns) and pose.
        """
        held = self._held
        while held:
            its_pass, stamp, _ = held[0]
            is_due = stamp <= until or len(held) > _MOST_AHEAD
            if its_pass > time_pass or (its_pass == time_pass and not is_due):
                return
            yield held.popleft()
