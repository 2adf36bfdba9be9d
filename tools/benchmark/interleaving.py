# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Times of things measured in turn, so that what disturbs the machine disturbs all of them.

The clock is the processor time of the one thread that works. On a quiet machine it runs as the
clock on the wall does; on a shared one it leaves out the time in which others had the core.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Seconds of processor time that this thread has had.
cpu_clock = time.thread_time

#: Does a thing once and returns how many seconds it took, preparations left out.
Timed = Callable[[], float]


@dataclass(frozen=True)
class Times:
    """Seconds of each repetition.

    Attributes
    ----------
    seconds : ndarray, (rounds, block)
    """

    seconds: Array

    @property
    def median_ms(self) -> float:
        """Median of all repetitions, milliseconds."""
        return float(np.median(self.seconds)) * 1e3

    def ratio_to(self, other: "Times") -> float:
        """Median over the rounds of the ratio of this one's median to the other's."""
        own, others = np.median(self.seconds, axis=1), np.median(other.seconds, axis=1)
        return float(np.median(own / others))


def interleave(things: Mapping[str, Timed], *, rounds: int, block: int) -> dict[str, Times]:
    """Time things in turn: a block of the first, a block of the second, and so on, round by round.

    A block rather than a single repetition, so that each finds the caches as it left them, as it
    would if it ran alone; its first repetition is left out.

    Parameters
    ----------
    things : mapping of str to callable
    rounds, block : int
        How many blocks of each, and repetitions in a block.

    Returns
    -------
    dict of str to Times
    """
    seconds: dict[str, list[list[float]]] = {name: [] for name in things}
    for _ in range(rounds):
        for name, timed in things.items():
            timed()
            seconds[name].append([timed() for _ in range(block)])
    return {name: Times(np.array(rows)) for name, rows in seconds.items()}
