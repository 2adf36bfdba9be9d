# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Noise levels of the motion, learned as the filter goes.

Where vision has seen a step, the filter knows how much the twist has changed in it and how far the
measured twist was off: the expectations of Shumway and Stoffer (*An approach to time series
smoothing and forecasting using the EM algorithm*, 1982), with filtered moments in place of
smoothed ones. On each axis, for the random step ``u = u_before + w``, ``w ~ N(0, Q)``, and for the
measurement ``z = h(x) + n``, ``n ~ N(0, R)`` ::

    E[w^2] = (g (u+ - u-))^2 + Q - g^2 (P- - P+),    g = Q / P-
    E[n^2] = (z - h(x+))^2 + H P+ H^T

where - and + stand for before and after all that was measured in the step. If all were one number,
with an innovation nu of variance S, then ``E[n^2] = R + (R / S)^2 (nu^2 - S)``, and the same of Q:
where vision sees little, an expectation stays near what was believed before it, and so would the
mean of all. ``(R / S)^2`` is the information of the step on R beside that of one that sees it
exactly, so a step counts by it: R moves by ``E[n^2] - R`` over the sum of what is known, Fisher's
scoring. Here ``R / S = 1 - H P+ H^T / R`` and ``Q / S = g (1 - P+ / P-)``. Of Q the sum is kept in
steps, for a body that stood begins to move again. Of R it is one of ``1 / S^2``: a sensor keeps
its noise, which is found from above, and a step told less while more of it was believed.

Slow errors of the model would pass for noise of the measured twist, so the level of its third
differences (see twist_noise), which know none, bounds it; that alone counts until vision has seen
enough.

Where the measured twist itself is slowly wrong, that bound is not: a velocity that points some
degrees beside the motion for minutes, as on KITTI-360, is smooth and repeats itself to the
centimetre. Vision contradicts it in most steps, so the median of the errors tells, which a few
wrong tracks do not move; where it exceeds the white noise threefold, it is the noise.

All look back only, so the levels are the same live and offline.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.motion import measures_velocity
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD, TwistNoise

Array = NDArray[np.float64]

# Memory of what vision has seen of the motion [s].
_MEMORY = 30.0
# Evidence, which comes by the step at any rate: a prior counts as a few steps that see it exactly,
# that of the walk is not trusted in the first steps, and so many must have been seen before they
# bound the measured twist's noise.
_PRIOR_STEPS = 5
_FIRST_STEPS = 10
_ENOUGH_STEPS = 50
# Beyond this many times the white noise, in squares, errors of the measured twist are slow ones.
_CONTRADICTED = 9.0
# To save time: their median is taken anew after so many steps.
_RENEWAL = 10
# How far off a measured twist may count that was not used [deviations].
_FARTHEST = 3.0
# A twist that repeats itself to the last digit is still no better than this [m/s, rad/s].
_SMALLEST_NOISE = (1e-5, 1e-6)
# A motion that never changes would make the twist constant for good [m/s/sqrt(s), rad/s/sqrt(s)].
_SMALLEST_WALK = np.repeat([3e-3, 3e-4], 3)


class MotionNoise:
    """Running noise of the measured twist, and density of the twist's own random walk.

    Parameters
    ----------
    twist_std : ndarray, (6,)
        Prior of a sample's white noise, metres and radians a second.
    walk_std : ndarray, (6,)
        Prior of the random walk, the same a root of a second.
    rate : FrameRate
        Of the steps, kept up to date by the filter.

    Attributes
    ----------
    walk_variance : ndarray, (6,)
        Variance of the twist's change in a second on each axis.
    """

    def __init__(self, twist_std: Array, walk_std: Array, rate: FrameRate):
        self._rate = rate
        self._told = twist_std, walk_std
        self._measures_velocity = True
        self.walk_variance: Array = np.square(walk_std)
        # What is known of it, in steps that see it exactly.
        self._walk_known: Array = np.full(6, float(_PRIOR_STEPS))
        self._begin(twist_std)

    def _begin(self, twist_std: Array) -> None:
        """Begin to learn the noise of the measured twist."""
        self._differences = TwistNoise(twist_std, self._rate)
        self._learned = 0
        # The noise of each sensor as vision sees it, and the information on it.
        self._seen_noise: Array = np.full(2, np.inf)
        self._information: Array = np.zeros(2)
        # Absolute errors of the measured twist by step, and what their median makes of the noise.
        self._errors: deque[Array] = deque()
        self._typical: Array = np.zeros(6)

    def tell(self, twist_std: Array, walk_std: Array) -> None:
        """Go on from priors (6,) that are other than before; what is as before stays as learned.

        The noise of the measured twist is then learned anew, on all axes.
        """
        anew, walks_anew = twist_std != self._told[0], walk_std != self._told[1]
        self._told = twist_std, walk_std
        self.walk_variance = np.where(walks_anew, np.square(walk_std), self.walk_variance)
        self._walk_known = np.where(walks_anew, _PRIOR_STEPS, self._walk_known)
        if np.any(anew):
            self._begin(np.where(anew, twist_std, self._differences.std))

    @property
    def begins(self) -> bool:
        """Whether there were only a few steps to learn from."""
        return self._learned < _FIRST_STEPS

    def add(self, twist: Array) -> None:
        """Add a measured twist (6,), its velocity NaN where there is none."""
        self._measures_velocity = measures_velocity(twist)
        self._differences.add(np.where(np.isnan(twist), 0.0, twist))

    @property
    def twist_variance(self) -> Array:
        """Variance (6,) of the measured twist; NaN of a velocity that is not measured.

        A sensor's white noise is alike on its three axes and the motion, which adds to the third
        differences, is not: the smallest axis counts.
        """
        levels = self._levels()
        if not self._measures_velocity:
            levels[:3] = math.nan
        return levels

    def _levels(self) -> Array:
        """Variances (6,), those of a velocity that is not measured as they were last."""
        # Number by number: numpy's calls would take ten times as long as the arithmetic.
        std, seen = self._differences.std.tolist(), self._seen_noise.tolist()
        typical = self._typical.tolist()
        levels: list[float] = []
        for i, smallest in enumerate(_SMALLEST_NOISE):
            axes = slice(3 * i, 3 * i + 3)
            level = min(std[axes]) ** 2
            if self._learned >= _ENOUGH_STEPS:
                level = min(level, seen[i])
                if sum(typical[axes]) / 3 > _CONTRADICTED * level:
                    level = sum(typical[axes]) / 3
            levels += 3 * [max(level, smallest**2)]
        return np.array(levels)

    def update(
        self,
        change: Array,
        before: Array,
        after: Array,
        error: Array,
        error_variance: Array,
        tau: float,
        *,
        is_used: bool = True,
    ) -> None:
        """Learn from a step in which vision has seen the motion.

        Parameters
        ----------
        change : ndarray, (6,)
            ``u+ - u-``: how far the step's measurements have moved the twist.
        before, after : ndarray, (6,)
            Variances P- and P+ of the twist.
        error, error_variance : ndarray, (6,)
            ``z - h(x+)`` of the measured twist, and the diagonal of ``H P+ H^T``; what was not
            measured is NaN.
        tau : float
            Seconds of the step.
        is_used : bool
            Whether the measured twist is one that images do not belie. One that they do counts
            as if it were three deviations off.
        """
        memory, R = self._rate.frames(_MEMORY), self._levels()
        self.walk_variance, self._walk_known = _learned_walk(
            self.walk_variance, self._walk_known, change, before, after, tau, memory
        )
        if not is_used:
            farthest = _FARTHEST * np.sqrt(R + error_variance)
            error = np.clip(error, -farthest, farthest)
        self._seen_noise, self._information = _learned_noise(
            R, self._information, error, error_variance, memory
        )
        self._learned += 1
        self._errors.append(np.where(np.isnan(error), 0.0, np.abs(error)))
        while len(self._errors) > memory:
            self._errors.popleft()
        if self._learned % _RENEWAL == 0:
            self._typical = np.square(MEDIAN_TO_STD * np.median(np.array(self._errors), axis=0))


@compiled("float64[::1](float64[::1])")
def _mean_of_sensors(numbers: Array) -> Array:
    """Means (2,) over the axes of the velocity and over those of the angular velocity."""
    return np.array([numbers[:3].sum() / 3.0, numbers[3:].sum() / 3.0])


@compiled(
    "UniTuple(float64[::1], 2)(float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64, int64)"
)
def _learned_walk(
    walk: Array,
    known: Array,
    change: Array,
    before: Array,
    after: Array,
    tau: float,
    memory: int,
) -> tuple[Array, Array]:
    """Variance of the walk (6,), and what is known of it in steps, after one more step."""
    Q = tau * walk
    gain = Q / before
    variance = ((gain * change) ** 2 + Q - gain**2 * (before - after)) / tau
    seen = gain * (1.0 - after / before)
    known = np.minimum(known + seen**2, memory)
    return np.maximum(walk + (variance - walk) / known, _SMALLEST_WALK**2), known


@compiled(
    "UniTuple(float64[::1], 2)(float64[::1], float64[::1], float64[::1], float64[::1], int64)"
)
def _learned_noise(
    R: Array, information: Array, error: Array, error_variance: Array, memory: int
) -> tuple[Array, Array]:
    """Variance of each sensor's noise (2,), and the information on it, after one more step."""
    unknown = np.isnan(error)
    squares = np.where(unknown, R, error**2 + error_variance)
    seen = np.where(unknown, 0.0, np.maximum(1.0 - error_variance / R, 0.0))
    level = R[::3]
    most = (memory - _PRIOR_STEPS) / level**2
    information = np.minimum(information + _mean_of_sensors((seen / R) ** 2), most)
    known = _PRIOR_STEPS + level**2 * information
    return level + (_mean_of_sensors(squares) - level) / known, information
