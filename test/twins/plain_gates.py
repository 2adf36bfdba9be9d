# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each innovation is worth, in its plainest form: given all the others, one after another."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.noise.track_noise import TrackNoise
from vislam_ros.core.tracking.tracked_frame import TrackedFrame

Array = NDArray[np.float64]


def given_others(residual: Array, S: Array, kept: list[int], i: int) -> tuple[Array, Array]:
    """Innovation (r,) of those (n, r) given all others that are kept, and its covariance."""
    r = residual.shape[1]
    own = r * i + np.arange(r)
    others = np.concatenate([[], *(r * j + np.arange(r) for j in kept if j != i)]).astype(int)
    gain = S[np.ix_(own, others)] @ np.linalg.inv(S[np.ix_(others, others)])
    error = residual[i] - gain @ residual.ravel()[others]
    return error, S[np.ix_(own, own)] - gain @ S[np.ix_(others, own)]


def agreeing(gate: float, residual: Array, S: Array, kept: list[int]) -> list[int]:
    """Which of some innovations (n, r) stay when those that the others contradict have gone."""
    remaining = list(kept)
    while gate > 0 and remaining:
        given = [given_others(residual, S, remaining, i) for i in remaining]
        distances = [error @ np.linalg.solve(C, error) for error, C in given]
        if max(distances) <= gate:
            break
        bound = max(gate, 0.5 * max(distances))
        remaining = [i for i, d in zip(remaining, distances, strict=True) if d <= bound]
    return remaining


def scale_with_tail(error: Array, A: Array, R: Array, own: float) -> float:
    """Scale s of an observation's noise (r,) for an innovation of covariance ``A + s R``."""
    s, r = own, len(error)
    for _ in range(6):
        information = np.linalg.inv(A + s * np.diag(R))
        w = information @ error
        of_noise = s**2 * w @ np.diag(R) @ w + s * (r - s * np.trace(information @ np.diag(R)))
        s = max(own, (6 * own + of_noise) / (6 + r))
    return s if s >= 1.5 * own else own


def scales_with_tails(residual: Array, S: Array, kept: list[int], R_0: Array, own: Array) -> Array:
    """Scales (n,) of the noise R_0 (n, r) of innovations, larger for those that are far off."""
    scales = own.copy()
    for i in kept:
        error, C = given_others(residual, S, kept, i)
        scales[i] = scale_with_tail(error, C - own[i] * np.diag(R_0[i]), R_0[i], own[i])
    return scales


def stated_factors(noise: TrackNoise, frame: TrackedFrame, told_variance: float) -> Array:
    """Factors (n,) on V of a frame's observations; those that it states are noted."""
    noise.is_stated = frame.noise is not None
    if frame.noise is None:
        return np.ones(len(frame.keys))
    variances = frame.noise**2 / told_variance
    noise.usual_factor = mean = float(np.mean(variances))
    return np.asarray((variances + max(noise.level - 1, 0) * mean) / max(noise.level, 1))


def distance(error: Array, covariance: Array, rows: slice) -> float:
    """Squared Mahalanobis distance of some rows of an error."""
    return float(error[rows] @ np.linalg.inv(covariance[rows, rows]) @ error[rows])
