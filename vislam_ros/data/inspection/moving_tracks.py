# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks that do not go with the scene: moving objects, wrong matches, points that slide.

Over the life of a track what it is off by adds up to noise alone where it belongs to the scene.
The sum S of its errors, with a disparity that is wrong throughout beside their own noise, has a
covariance C, and ``S^T C^-1 S`` is chi-square of two degrees of freedom.
"""

import math

import numpy as np
from scipy.stats import chi2

from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD
from vislam_ros.data.finding import Finding
from vislam_ros.data.inspection.step_motions import StepMotions

#: Tracks that must be looked at.
FEWEST_TRACKS = 50
# Steps that a track must have, and by how many standard deviations one of them may count.
_FEWEST_STEPS, _MOST_STD = 3, 9.0
# A track that belongs to the scene is taken for one that does not once in so many.
_FALSE_ALARM = 1e-6
# Noise of a pixel at least, and a disparity's error for the life of its track [px].
_LEAST_STD, _DISPARITY_STD = 1.0, 1.0
# A smaller share does no harm. Standard deviations of the share.
_USUAL, _BEYOND_CHANCE = 0.005, 3.0


def judge_moving_tracks(off: int, tracks: int) -> Finding | None:
    """Tell the share of tracks that are off; None where it is small, or may be."""
    share = off / tracks
    error = math.sqrt(max(share * (1.0 - share), 1.0 / tracks) / tracks)
    if share - _BEYOND_CHANCE * error <= _USUAL:
        return None
    return Finding(
        "moving_tracks",
        f"{share:.0%} of {tracks} tracks do not go with the scene",
        "moving objects or wrong matches, which the gates reject",
        True,
        {"share": share, "tracks": tracks, "off": off},
    )


def tracks_off(motions: StepMotions) -> tuple[int, int] | None:
    """Count the tracks that go their own way, and all; None for too few."""
    errors = motions.errors.copy()
    told = motions.by_twist
    if told.any():
        # What a bias of the twist moves all by is no track's.
        errors[told] -= np.median(errors[told], axis=0)
    C = motions.noise
    # Errors along axes in which their noise is white.
    L_inverse = np.linalg.inv(np.linalg.cholesky(C)) if len(C) else C
    white = np.einsum("nij,nj->ni", L_inverse, errors)
    along = np.einsum("nij,nj->ni", L_inverse, motions.by_disparity)
    _, track = np.unique(motions.tracks, return_inverse=True)
    counts = np.bincount(track) if len(track) else np.empty(0, dtype=int)
    long = counts >= _FEWEST_STEPS
    if np.sum(long) < FEWEST_TRACKS:
        return None
    std = max(MEDIAN_TO_STD * float(np.median(np.abs(white))), _LEAST_STD)
    white = np.clip(white / std, -_MOST_STD, _MOST_STD)
    along = along * (_DISPARITY_STD / std)
    S, G = (_sums(values, track, len(counts))[long] for values in (white, along))
    # C = n I + G G^T, whose inverse is known.
    n = counts[long].astype(float)
    projected = np.sum(G * S, axis=1)
    square = np.sum(S * S, axis=1) / n
    square -= projected**2 / (n * (n + np.sum(G * G, axis=1)))
    return int(np.sum(square > chi2.isf(_FALSE_ALARM, 2))), len(n)


def _sums(
    values: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    track: np.ndarray[tuple[int], np.dtype[np.intp]],
    tracks: int,
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Sums (tracks, 2) of values (n, 2) by track."""
    return np.column_stack([np.bincount(track, values[:, i], tracks) for i in range(2)])
