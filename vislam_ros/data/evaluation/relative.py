# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the motion between two poses: from frame to frame, and over stretches of the path."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Stretches in KITTI's manner: metres, and at every how many poses one begins.
_LENGTHS = 50.0 * np.arange(1, 9)
_EVERY = 10
# A shorter path has stretches of eighths of its length, metres.
_SHORT_PATH = 100.0
# What stays within this reach has no path, and no stretch is shorter, metres: noise would rule it.
_REACH = 0.1


def frame_pairs(poses: int, delta: int = 1) -> Indices:
    """Rows (n, 2) of poses that are ``delta`` frames apart, each pair beginning at the last."""
    rows = np.arange(0, poses, delta)
    return np.stack([rows[:-1], rows[1:]], axis=1)


def distance_pairs(positions: Array, delta: float) -> Indices:
    """Rows (n, 2) of poses with at least ``delta`` metres of path between them.

    Each pair begins where the one before ended.
    """
    ends, path = [0], 0.0
    for row, length in enumerate(np.linalg.norm(np.diff(positions, axis=0), axis=1), start=1):
        path += float(length)
        if path >= delta:
            ends.append(row)
            path = 0.0
    return np.stack([ends[:-1], ends[1:]], axis=1).astype(np.int64)


def relative_errors(T_reference: Array, T_estimate: Array, pairs: Indices) -> tuple[Array, Array]:
    """Error of the motion between the two poses of each pair.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)
    pairs : ndarray, (m, 2)

    Returns
    -------
    tuple of ndarray, (m,) each
        Length of the translation part, metres, and angle, radians.
    """
    i, j = pairs.T
    E = se3.inverse(se3.inverse(T_reference[i]) @ T_reference[j]) @ (
        se3.inverse(T_estimate[i]) @ T_estimate[j]
    )
    angles = np.linalg.norm(se3.log_rotation(E[:, :3, :3]), axis=1)
    return np.linalg.norm(E[:, :3, 3], axis=1), angles


@dataclass(frozen=True)
class StretchErrors:
    """Errors of the motion over stretches of the path, a row for each.

    Attributes
    ----------
    lengths : ndarray, (n,)
        Metres.
    metres, radians : ndarray, (n,)
        Error of the translation, and of the turn.
    """

    lengths: Array
    metres: Array
    radians: Array

    def figures(self) -> dict[str, float] | None:
        """Means over all stretches: their number, % of the length, degrees a 100 m."""
        if not len(self.lengths):
            return None
        turns = np.rad2deg(self.radians)
        return {
            "stretches": len(self.lengths),
            "translation_percent": float(np.mean(100.0 * self.metres / self.lengths)),
            "rotation_deg_per_100m": float(np.mean(100.0 * turns / self.lengths)),
        }

    def by_length(self) -> list[dict[str, float]]:
        """Those of each length, ``length_m``, that has a stretch, the shortest first."""
        rows = []
        for length in np.unique(self.lengths):
            of_it = self.lengths == length
            part = StretchErrors(self.lengths[of_it], self.metres[of_it], self.radians[of_it])
            rows.append({"length_m": float(length), **(part.figures() or {})})
        return rows


def stretch_errors(T_reference: Array, T_estimate: Array) -> StretchErrors:
    """Errors over distances in KITTI's manner.

    Of each stretch of 50, 100, ... 400 m the estimated motion is compared with the true one; one
    of each length begins at every tenth pose (Geiger, Lenz and Urtasun, *Are we ready for
    autonomous driving?*, 2012). A path of less than 100 m has stretches of one to six eighths of
    its length.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)
        Poses that belong together.

    Returns
    -------
    StretchErrors
        Of no stretch where the reference stands still, and of none shorter than 0.1 m.
    """
    positions = T_reference[:, :3, 3]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    lengths = _LENGTHS if way[-1] >= _SHORT_PATH else way[-1] * np.arange(1, 7) / 8
    begins = np.arange(0, len(way), _EVERY)
    pairs, over = [np.empty((0, 2), dtype=np.int64)], [np.empty(0)]
    stands = float(np.linalg.norm(np.ptp(positions, axis=0))) < _REACH
    for length in [] if stands else lengths[lengths >= _REACH]:
        ends = np.searchsorted(way, way[begins] + length)
        there = ends < len(way)
        pairs.append(np.stack([begins[there], ends[there]], axis=1))
        over.append(np.full(len(pairs[-1]), length))
    metres, radians = relative_errors(T_reference, T_estimate, np.concatenate(pairs))
    return StretchErrors(np.concatenate(over), metres, radians)
