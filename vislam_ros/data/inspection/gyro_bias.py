# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A constant error of the gyroscope: its turns less those of the images, over a whole drive.

Its mean over the steps is the bias, whatever the noise of either. By the covariance that blocks of
steps tell, its square is Hotelling's T^2 where there is none (*The generalization of Student's
ratio*, 1931).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD
from vislam_ros.data.finding import Finding
from vislam_ros.data.inspection.step_motions import StepMotions

Array = NDArray[np.float64]

#: Steps whose images must tell the turn.
FEWEST_STEPS = 20
# Once in so many drives without a bias one is found.
_FALSE_ALARM = 1e-3
# Errors of neighbouring steps have a frame in common; those of blocks count as apart, of which
# there are so many at least where there are steps enough, and of so many steps at most.
_BLOCKS, _LONGEST_BLOCK = 10, 10
# Huber's constant, in standard deviations.
_HUBER, _ROUNDS = 1.345, 20
_LEAST_STD = 1e-7  # rad/s


def judge_gyro_bias(motions: StepMotions) -> Finding | None:
    """Tell the bias; None where there is none beyond chance, or too few steps tell."""
    errors = motions.turn_errors
    if len(errors) < FEWEST_STEPS:
        return None
    bias, covariance = robust_mean(errors)
    square = float(bias @ np.linalg.solve(covariance, bias))
    blocks = -(-len(errors) // _block(len(errors)))
    if square * (blocks - 3) / (3 * (blocks - 1)) < fisher.isf(_FALSE_ALARM, 3, blocks - 3):
        return None
    std = np.sqrt(np.diag(covariance))
    return Finding(
        "gyro_bias",
        f"about ({bias[0]:+.4f}, {bias[1]:+.4f}, {bias[2]:+.4f}) rad/s, +- {std.max():.4f}",
        "estimated along with the pose (gyro_bias_std)",
        True,
        {"bias_rad_s": bias.tolist(), "std_rad_s": std.tolist(), "squared_distance": square},
    )


def robust_mean(errors: Array) -> tuple[Array, Array]:
    """Mean (3,) of errors (n, 3) with Huber's weights, and its covariance (3, 3) by blocks."""
    mean = np.median(errors, axis=0)
    for _ in range(_ROUNDS):
        residuals = errors - mean
        std = np.maximum(MEDIAN_TO_STD * np.median(np.abs(residuals), axis=0), _LEAST_STD)
        weights = np.minimum(1.0, _HUBER * std / np.maximum(np.abs(residuals), 1e-300))
        mean = mean + np.sum(weights * residuals, axis=0) / np.sum(weights, axis=0)
    scores = weights * (errors - mean) / np.mean(np.abs(errors - mean) < _HUBER * std, axis=0)
    sums = np.add.reduceat(scores, np.arange(0, len(scores), _block(len(scores))))
    n = len(errors)
    covariance = sums.T @ sums / n**2 + np.eye(3) * (_LEAST_STD**2)
    return mean, covariance


def _block(steps: int) -> int:
    """Steps of a block."""
    return min(max(steps // _BLOCKS, 1), _LONGEST_BLOCK)
