# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which feature frames the graph has answered: back-pressure for a player at full speed."""

import threading
from collections import deque


class FeatureWindow:
    """Feature stamps that were sent and not yet answered by an odometry.

    An answer counts for every frame sent before the one it answers, so a frame that the graph
    refuses holds nobody up. The graph may also say how many it is done with.

    Parameters
    ----------
    condition : threading.Condition
        Guards the window and is notified where enough is answered, or the graph says so.

    Attributes
    ----------
    sent, acknowledged, taken : int
        Frames sent, frames that the graph is done with, and those that it says it has taken.
    answered : bool
        Whether answers are to be expected.
    enough : int
        How few frames may wait for an answer before it wakes who waits on the condition.
    """

    def __init__(self, condition: threading.Condition):
        self._condition = condition
        self._waiting: deque[int | None] = deque()
        self.sent = 0
        self.acknowledged = 0
        self.taken = 0
        self.answered = True
        self.enough = 0

    @property
    def waiting(self) -> int:
        """How many frames are not answered yet."""
        return len(self._waiting)

    @property
    def progress(self) -> tuple[int, int]:
        """What changes where the graph does anything."""
        return self.acknowledged, self.taken

    def add(self, stamp: int | None) -> None:
        """Note a frame (ns) that is about to be sent; None where its stamp cannot be read."""
        with self._condition:
            self._waiting.append(stamp)
            self.sent += 1

    def acknowledge(self, stamp: int) -> None:
        """Note an odometry with this stamp (ns)."""
        with self._condition:
            while stamp in self._waiting or (self._waiting and self._is_late(stamp)):
                self._pop()
            self.answered = True
            if len(self._waiting) <= self.enough:
                self._condition.notify_all()

    def settle(self, taken: int, waiting: int) -> None:
        """Note that the graph has taken so many frames, of which some wait for their motion."""
        with self._condition:
            self.taken = taken
            while self._waiting and self.sent - len(self._waiting) < taken - waiting:
                self._pop()
            self._condition.notify_all()

    def expect(self) -> None:
        """Expect answers, whatever was before."""
        with self._condition:
            self.answered = True

    def forget(self) -> None:
        """Give up the frames that are not answered yet."""
        with self._condition:
            self._waiting.clear()

    def expect_none(self) -> None:
        """Give them up, and expect no answers until the next one comes."""
        with self._condition:
            self._waiting.clear()
            self.answered = False

    def _is_late(self, stamp: int) -> bool:
        """Whether the first frame was sent after a newer one that is answered with a stamp."""
        first = self._waiting[0]
        return first is not None and first <= stamp

    def _pop(self) -> None:
        self._waiting.popleft()
        self.acknowledged += 1
