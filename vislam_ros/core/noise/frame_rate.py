# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many frames a span of time holds.

What a drive's noise was half a minute ago may matter, at any frame rate: memories are given in
seconds, and running means and medians want frames. A camera's rate is a whole number of hertz
while its stamps jitter and frames get lost, so it is the median's that counts, rounded.
"""

import statistics
from collections import deque

# A second or three: enough to outvote jitter and losses, and soon through with a new rate.
_DURATIONS = 31
# Until there are two frames [Hz]. A camera slower than this least rate counts as if it had it.
_FIRST_RATE, _LEAST_RATE = 10, 1


class FrameRate:
    """Nominal rate of a stream of frames.

    Attributes
    ----------
    hertz : int
    """

    def __init__(self) -> None:
        self._durations: deque[float] = deque(maxlen=_DURATIONS)
        self._usual = 1.0 / _FIRST_RATE
        self.hertz = _FIRST_RATE

    def add(self, tau: float) -> None:
        """Add a step of tau seconds between two frames."""
        self._durations.append(tau)
        self._usual = statistics.median(self._durations)
        self.hertz = max(round(1.0 / self._usual), _LEAST_RATE)

    def enter(self, tau: float) -> int:
        """Add a step of tau seconds, if it took any; return the frames missed in it."""
        if not tau:
            return 0
        self.add(tau)
        return self.missed(tau)

    def missed(self, tau: float) -> int:
        """Frames that should have come within a step of tau seconds and did not."""
        return max(round(tau / self._usual) - 1, 0)

    @property
    def usual(self) -> float:
        """Usual duration of a step, seconds."""
        return self._usual

    def frames(self, seconds: float) -> int:
        """Frames in a span of time."""
        return max(round(seconds * self.hertz), 1)
