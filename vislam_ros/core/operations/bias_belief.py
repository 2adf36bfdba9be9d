# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the gyroscope has a bias at all: most of the prior is at none.

Few tracks with errors that stay make up a small bias, and over a drive a small bias bends the path
more than it would be without. So there are two models: the filter's own, with a bias b of prior
covariance Sigma_0, and the same with ``b = 0``. The second is the first conditioned on it, which
for a Gaussian takes no second filter: ``x -> x - P_xb P_bb^-1 b``. And what the data say for it
is the density of b at zero after them over that before (Dickey, *The weighted likelihood ratio,
linear hypotheses on normal location parameters*, 1971; the ratio of Savage and Dickey)::

    p(data | b = 0) / p(data | b) = N(0; b, P_bb) / N(0; 0, Sigma_0)

Before the data nearly all belief is in none: at the beginning of a drive a few tracks on a car
that moves, or a motion that the twist tells wrongly for seconds, look like a bias of a usual size,
and no likelihood tells them apart. A bias that there is stays, and is believed seconds later.

Both are kept: the state that is told is their mean by the share w of belief in none, ``x - w P_xb
P_bb^-1 b``, and its covariance has the distance between the two in it. To the way back it is one
more correction, by ``b = 0`` with the noise ``P_bb (1 / w - 1)``.

The errors of real tracks are not white: the covariance that they leave is too small by a factor of
five to ten (NEES on the recorded drives), and a bias of a few of its standard deviations is none.
So the data's information on the bias counts as one part in kappa of itself in the ratio, with how
many observations tell as much as one that is independent (see track_noise): 1 where errors are
seen to be white.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.small_inverse import small_inverse
from vislam_ros.core.operations.correction import VehicleCorrection

Array = NDArray[np.float64]

# Belief in no bias before the data.
_PRIOR_AT_NONE = 0.97
# Less than this changes nothing that can be seen.
_LEAST_SHARE = 1e-9


class BiasBelief(NamedTuple):
    """The belief that there is no bias, and what follows from it for all of the error state.

    Attributes
    ----------
    none : float
        Share of the belief in none, 0 to 1.
    gain : ndarray, (D, 3)
        ``P_xb P_bb^-1``.
    covariance : ndarray, (3, 3)
        ``P_bb``.
    bias : ndarray, (3,)
        Where there is one, rad/s.
    """

    none: float
    gain: Array
    covariance: Array
    bias: Array

    @property
    def changes(self) -> bool:
        """Whether it changes anything that can be seen."""
        return self.none > _LEAST_SHARE

    @property
    def delta(self) -> Array:
        """What the error state is to be moved by (D,)."""
        return -self.none * (self.gain @ self.bias)

    @property
    def spread(self) -> Array:
        """M (3, 3): for components with gains G_1 and G_2 the covariance grows by ``G_1 M G_2^T``.

        What is known of the bias where there is none goes, and how far the two beliefs are apart
        comes.
        """
        apart = (1.0 - self.none) * np.outer(self.bias, self.bias)
        return np.asarray(self.none * (apart - self.covariance))

    @property
    def bias_std(self) -> Array:
        """Of the bias that is told (3,), rad/s: as far as the one that there may be is from it.

        That of the mixture would be far too sure of none where a bias is small.
        """
        return np.asarray(np.sqrt(self.covariance.diagonal() + (self.none * self.bias) ** 2))

    def as_correction(self, rows: slice, vehicle_size: int) -> VehicleCorrection | None:
        """``b = 0`` with the noise that makes the same of the mean; None where it changes nothing.

        With ``P_bb = L L^T`` the rows ``L^-1 b`` have unit covariance and independent noise.
        """
        if not self.changes:
            return None
        L_inverse = np.linalg.inv(np.linalg.cholesky(self.covariance))
        H = np.zeros((3, vehicle_size))
        H[:, rows] = L_inverse
        noise = np.full(3, 1.0 / self.none - 1.0)
        return VehicleCorrection(-(L_inverse @ self.bias), noise, H)


def bias_belief(
    covariance: Array, rows: slice, bias: Array, prior_variance: float, *, temper: float
) -> BiasBelief:
    """Weigh a bias against none.

    Parameters
    ----------
    covariance : ndarray, (D, D)
        Of the error state, given that there is a bias.
    rows : slice
        Of the bias in it.
    bias : ndarray, (3,)
        The estimate, rad/s.
    prior_variance : float
        On each axis, (rad/s)^2; 0 where there is no bias to weigh.
    temper : float
        kappa: what the data tell counts as one part in so many, 1 or more.
    """
    P_bb = covariance[rows, rows].copy()
    if not prior_variance > 0.0:
        return BiasBelief(0.0, np.zeros((len(covariance), 3)), P_bb, bias)
    log_ratio, information = _weighed(P_bb, bias, prior_variance, temper)
    odds = math.exp(min(log_ratio, 500.0)) * _PRIOR_AT_NONE / (1.0 - _PRIOR_AT_NONE)
    return BiasBelief(odds / (1.0 + odds), covariance[:, rows] @ information, P_bb, bias)


@compiled("Tuple((float64, float64[:, ::1]))(float64[:, ::1], float64[::1], float64, float64)")
def _weighed(
    P_bb: Array, bias: Array, prior_variance: float, temper: float
) -> tuple[float, Array]:
    """How much the data say for none, a logarithm, and ``P_bb^-1`` (3, 3)."""
    information, _ = small_inverse(P_bb)
    prior = np.eye(3) / prior_variance
    covariance, narrowed = small_inverse(prior + (information - prior) / temper)
    vector = information @ bias / temper
    distance = vector @ (covariance @ vector)
    narrowing = math.log(narrowed) + 3.0 * math.log(prior_variance)
    return 0.5 * (narrowing - float(distance)), information
