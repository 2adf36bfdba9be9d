# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""White noise of a twist, read off its third differences."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.noise.frame_rate import FrameRate

Array = NDArray[np.float64]

# A third difference of white noise has 1 + 9 + 9 + 1 = 20 times its variance, while the motion of
# a vehicle, smooth over four samples, all but cancels. The median passes over jerks.
_VARIANCE_RATIO = 20.0
#: Median of the absolute value of a standard normal variable, inverted.
MEDIAN_TO_STD = 1.4826
# Memory [s]; at 10 Hz enough to know an axis to 9 %.
_MEMORY = 30.0
# To save time: the median is taken anew at every sample at first, and then at every tenth.
_OFTEN, _RENEWAL = 50, 10
# Evidence, which comes by the sample at any rate: the prior counts as this many third differences
# at first, and fades by the square of their number from so many on: it may be a hundredfold off.
_PRIOR_WEIGHT, _PRIOR_FADES = 10, 5


def white_noise_std(third_differences: Array) -> Array:
    """Standard deviation (k,) of the white noise behind absolute third differences (n, k)."""
    n = len(third_differences)
    middle = [(n - 1) // 2, n // 2]
    ordered = np.partition(third_differences, middle, axis=0)
    median: Array = 0.5 * (ordered[middle[0]] + ordered[middle[1]])
    return MEDIAN_TO_STD * median / np.sqrt(_VARIANCE_RATIO)


def white_noise_levels(twists: Array) -> tuple[float, float]:
    """White noise of the velocities (m/s) and angular velocities (rad/s) of twists (n, 6).

    Of three axes that count which the motion itself jerks least; infinite for fewer than four
    twists.
    """
    if len(twists) < 4:
        return np.inf, np.inf
    std = white_noise_std(np.abs(np.diff(twists, 3, axis=0)))
    return float(std[:3].min()), float(std[3:].min())


class TwistNoise:
    """Running estimate of the standard deviation of each axis (6,) of a twist.

    It looks at past samples only, so it is the same live and offline.

    Parameters
    ----------
    prior : ndarray, (6,)
        Standard deviations before there are samples.
    rate : FrameRate
        Of the samples, kept up to date by the filter.

    Attributes
    ----------
    std : ndarray, (6,)
        Standard deviations, metres and radians a second.
    """

    def __init__(self, prior: Array, rate: FrameRate):
        self._prior = prior
        self._rate = rate
        self._samples: deque[Array] = deque(maxlen=4)
        # Absolute third differences, the latest last.
        self._differences: deque[Array] = deque()
        self._added = 0
        self.std: Array = prior

    def add(self, twist: Array) -> None:
        """Add a sample (6,)."""
        self._samples.append(twist)
        if len(self._samples) == 4:
            a, b, c, d = self._samples
            self._differences.append(np.abs(d - 3 * c + 3 * b - a))
            while len(self._differences) > self._rate.frames(_MEMORY):
                self._differences.popleft()
            self._added += 1
            if self._added < _OFTEN or self._added % _RENEWAL == 0:
                self.std = self._measured()

    def _measured(self) -> Array:
        count = len(self._differences)
        measured = white_noise_std(np.array(self._differences))
        weight = _PRIOR_WEIGHT / max(1.0, (count / _PRIOR_FADES) ** 2)
        variance = (weight * self._prior**2 + count * measured**2) / (weight + count)
        return np.sqrt(variance)
