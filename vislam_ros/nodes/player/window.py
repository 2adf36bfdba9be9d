# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which feature frames the graph has answered: back-pressure for a player at full speed."""

import threading
from collections import deque


class FeatureWindow:
    """Feature stamps that were sent and not yet answered by an odometry.

    An answer counts for every frame sent before it with a stamp up to its own, so a frame that
    the graph refuses holds nobody up.

    Parameters
    ----------
    condition : threading.Condition
        Guards the window and is notified on each answer.

    Attributes
    ----------
    sent, acknowledged : int
        Frames sent, and frames answered.
    answered : bool
        Whether answers are to be expected.
    """

    def __init__(self, condition: threading.Condition):
        self._condition = condition
        self._waiting: deque[int] = deque()
        self.sent = 0
        self.acknowledged = 0
        self.answered = True

    @property
    def waiting(self) -> int:
        """How many frames are not answered yet."""
        return len(self._waiting)

    def add(self, stamp: int) -> None:
        """Note a frame (ns) that is about to be sent."""
        with self._condition:
            self._waiting.append(stamp)
            self.sent += 1

    def acknowledge(self, stamp: int) -> None:
        """Note an odometry with this stamp (ns)."""
        with self._condition:
            while self._waiting and self._waiting[0] <= stamp:
                self._waiting.popleft()
                self.acknowledged += 1
            self.answered = True
            self._condition.notify_all()

    def has_acknowledged_more(self, count: int) -> bool:
        """Whether more than so many frames are answered."""
        return self.acknowledged > count

    def forget(self) -> None:
        """Expect no answers until the next one comes."""
        with self._condition:
            self._waiting.clear()
            self.answered = False
