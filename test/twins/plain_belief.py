# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bias and none weighed against each other, by the textbook."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import multivariate_normal

Array = NDArray[np.float64]


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


def told_of_both(
    P: Array, rows: slice, b: Array, prior_variance: float, ratio: float = 1.0
) -> Told:
    """Weigh the belief in a bias, of which b (3,) and P (D, D) are known, against that in none.

    Of the data's information on the bias one part in ``ratio`` counts.
    """
    if prior_variance == 0:
        return Told(0.0, np.zeros(len(P)), P, P)
    zero, prior, P_bb = np.zeros(3), prior_variance * np.eye(3), P[rows, rows]
    # The data's own information.
    information = np.linalg.inv(P_bb) - np.linalg.inv(prior)
    P_counted = np.linalg.inv(np.linalg.inv(prior) + information / ratio)
    b_counted = P_counted @ np.linalg.inv(P_bb) @ b / ratio
    after = multivariate_normal(b_counted, P_counted).logpdf(zero)
    before = multivariate_normal(zero, prior).logpdf(zero)
    none = float(expit(after - before))
    gain = P[:, rows] @ np.linalg.inv(P_bb)
    mean_of_none, P_of_none = -gain @ b, P - gain @ P[rows]
    mean = none * mean_of_none
    within = none * P_of_none + (1 - none) * P
    away = mean_of_none - mean
    between = none * np.outer(away, away) + (1 - none) * np.outer(mean, mean)
    return Told(none, mean, within + between, within)


def birge_ratio(history: list[tuple[float, Array, Array]], walk_variance: float) -> float:
    """Mean square of the moves of a bias over stretches of five seconds.

    With those of recorded drives, three numbers of ten.

    Parameters
    ----------
    history : list of tuple
        Seconds of a step, and the bias (3,) and its covariance (3, 3) after it.
    walk_variance : float
        Of the bias itself, in a second.
    """
    squares, elapsed, before = [10.0, 10.0, 10.0], 0.0, None
    for seconds, b, P in history:
        elapsed += seconds
        if elapsed < 5.0:
            continue
        if before is not None:
            expected = before[1] + elapsed * walk_variance * np.eye(3) - P
            if not _tells(expected, before[1]):
                continue
            move = b - before[0]
            squares += [float(move @ np.linalg.solve(expected, move)), 0.0, 0.0]
        elapsed, before = 0.0, (b, P)
    return max(1.0, float(np.mean(squares)))


def _tells(shrunk: Array, P: Array) -> bool:
    """Whether each direction has lost a part in a million of its variance."""
    shares = np.linalg.eigvals(np.linalg.solve(P, shrunk)).real
    return bool(shares.min() > 1e-6)
