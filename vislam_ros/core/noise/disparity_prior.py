# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Prior of a new landmark's disparity, from the drive's other landmarks.

A first observation scatters about the true disparity, and the scatter is not the same both ways:
most points lie at some middle distance, so a disparity that is measured far from there is the
more likely one that noise has carried there (the regression to the mean; compare Efron,
*Tweedie's formula and selection bias*, 2011). A filter that takes first observations at face
value reads every motion a little wrong, in the same direction all the time.

The prior is log-normal, from the quartiles of the disparities at which landmarks have begun so
far, with a share of points at infinity. The posterior's mean and variance are sums over a grid
about each measurement.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Array = NDArray[np.float64]

# Counted in landmarks, for each has one first observation at any frame rate: the memory, in which
# quartiles are good to 3 % of the spread, and what there must be before there is a prior. On the
# drives 2000 come in a minute or so.
_MEMORY = 2000
_ENOUGH = 100
# To save time: the quartiles are taken anew after every so many.
_RENEWAL = 50
# Share of points at infinity. On the drives a hundredth has no positive disparity.
_AT_INFINITY = 0.02
# The lower quartile must exceed the noise by so much for its logarithm to mean something.
_LEAST_QUARTILE = 1.5
# What lies farther off from its posterior mean than this does not come from the prior [std].
_FARTHEST = 3.0
# A posterior keeps at least this share of the measured variance: the prior is only a fit.
_LEAST_VARIANCE = 0.1
# Distance of the quartiles of a standard normal variable.
_QUARTILES = 1.349
# About a measurement, in its standard deviations.
_GRID = np.linspace(-5.0, 5.0, 41)
# Weights that sum up to no more than this say nothing.
_TINY = float(np.finfo(float).tiny)


class DisparityPrior:
    """Prior of the disparities of new landmarks, learned from those before them."""

    def __init__(self) -> None:
        self._ring = np.empty(_MEMORY)
        self._count = 0
        self._renewed = -_RENEWAL
        self._quartiles: Array = np.zeros(3)

    def add(self, disparities: Array) -> None:
        """Learn from measured disparities (n,), pixels."""
        places = (self._count + np.arange(len(disparities))) % _MEMORY
        self._ring[places] = disparities
        self._count += len(disparities)
        if self._count >= _ENOUGH and self._count - self._renewed >= _RENEWAL:
            self._renewed = self._count
            self._quartiles = np.quantile(self._ring[: self._count], [0.25, 0.5, 0.75])

    def posterior(self, measured: Array, variance: Array) -> tuple[Array, Array]:
        """Mean and variance (n,) of disparities, given what was measured of them.

        Parameters
        ----------
        measured : ndarray, (n,)
            Pixels.
        variance : ndarray, (n,)
            Of the measurements, square pixels.

        Returns
        -------
        mean, variance : ndarray, (n,)
            What was measured, where there is no prior yet or the two contradict each other.
        """
        low, middle, high = self._quartiles
        if not low > _LEAST_QUARTILE * np.sqrt(np.min(variance, initial=np.inf)) or not high > low:
            return measured, variance
        return _posterior(measured, variance, middle, math.log(high / low) / _QUARTILES)

    def apply(self, y: Array, noise: Array) -> tuple[Array, Array]:
        """Posterior of first image points (n, 3) with covariances (n, 3, 3).

        Learns from them first. What of an image point goes with its disparity ``u_left -
        u_right`` moves along.
        """
        measured = y[:, 0] - y[:, 1]
        self.add(measured)
        with_disparity = noise[:, :, 0] - noise[:, :, 1]
        variance = with_disparity[:, 0] - with_disparity[:, 1]
        mean, remaining = self.posterior(measured, variance)
        gain = with_disparity / variance[:, None]
        known = (variance - remaining)[:, None, None]
        return (
            y + gain * (mean - measured)[:, None],
            noise - known * gain[:, :, None] * gain[:, None, :],
        )


@compiled("UniTuple(float64[::1], 2)(float64[:], float64[:], float64, float64)")
def _posterior(
    measured: Array, variance: Array, middle: float, spread: float
) -> tuple[Array, Array]:
    """Posterior under a log-normal prior about a median, with points at infinity."""
    mean, remaining = measured.copy(), variance.copy()
    odds = math.sqrt(2 * math.pi) * _AT_INFINITY / (1.0 - _AT_INFINITY)
    for i in range(len(measured)):
        y, std = measured[i], math.sqrt(variance[i])
        width = (_GRID[1] - _GRID[0]) * std
        # The points at infinity: all their weight in one.
        total = odds * math.exp(-0.5 * y * y / variance[i])
        shift, square = -total * y, total * y * y
        for step in _GRID:
            off = std * step
            if y + off > 0:
                positive = max(y + off, 1e-3)
                from_median = math.log(positive / middle) / spread
                density = math.exp(-0.5 * from_median * from_median) / (positive * spread)
                weight = density * math.exp(-0.5 * step * step) * width
                total += weight
                shift += weight * off
                square += weight * off * off
        if total > _TINY:
            shift, square = shift / total, square / total
            if abs(shift) < _FARTHEST * std:
                mean[i] = y + shift
                left = max(square - shift * shift, _LEAST_VARIANCE * variance[i])
                remaining[i] = min(left, variance[i])
    return mean, remaining
