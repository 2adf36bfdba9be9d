# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bias and none weighed against each other, by the textbook."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit
from scipy.stats import multivariate_normal

Array = NDArray[np.float64]

PRIOR_AT_NONE = 0.97


class Told(NamedTuple):
    """What is told of the error state, of which there are two beliefs.

    Attributes
    ----------
    none : float
        Share of the belief that there is no bias.
    mean : ndarray, (D,)
        Of the error.
    covariance : ndarray, (D, D)
    within : ndarray, (D, D)
        The same without the spread between the two beliefs, which the way back leaves out.
    """

    none: float
    mean: Array
    covariance: Array
    within: Array


def told_of_both(P: Array, rows: slice, b: Array, prior_variance: float, temper: float) -> Told:
    """Weigh the belief in a bias, of which b (3,) and P (D, D) are known, against that in none."""
    if prior_variance == 0:
        return Told(0.0, np.zeros(len(P)), P, P)
    zero, prior, P_bb = np.zeros(3), prior_variance * np.eye(3), P[rows, rows]
    # The data's own information, of which one part in so many counts.
    information = np.linalg.inv(P_bb) - np.linalg.inv(prior)
    P_counted = np.linalg.inv(np.linalg.inv(prior) + information / temper)
    b_counted = P_counted @ np.linalg.inv(P_bb) @ b / temper
    after = multivariate_normal(b_counted, P_counted).logpdf(zero)
    before = multivariate_normal(zero, prior).logpdf(zero)
    none = float(expit(logit(PRIOR_AT_NONE) + after - before))
    gain = P[:, rows] @ np.linalg.inv(P_bb)
    mean_of_none, P_of_none = -gain @ b, P - gain @ P[rows]
    mean = none * mean_of_none
    within = none * P_of_none + (1 - none) * P
    away = mean_of_none - mean
    between = none * np.outer(away, away) + (1 - none) * np.outer(mean, mean)
    return Told(none, mean, within + between, within)
