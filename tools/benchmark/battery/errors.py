# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The error over distances, in KITTI's manner.

Of each stretch of 50, 100, ... 400 m the estimated motion is compared with the true one (Geiger,
Lenz and Urtasun, *Are we ready for autonomous driving?*, 2012). A path of less than 100 m has
stretches of eighths of its length.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.evaluate import associate
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

_LENGTHS = 50.0 * np.arange(1, 9)
_SHORT_PATH = 100.0
# A stretch begins at every so many poses.
_EVERY = 10


def stretch_errors(reference: Trajectory, estimate: Trajectory) -> tuple[Array, Array]:
    """Errors (n,) of the position at the ends of all stretches, and their lengths (n,), metres."""
    i, j = associate(reference, estimate)
    true, found = reference.T_world_body[i], estimate.T_world_body[j]
    steps = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    lengths = _LENGTHS if way[-1] >= _SHORT_PATH else way[-1] * np.arange(1, 7) / 8
    errors, over = [], []
    begins = np.arange(0, len(way), _EVERY)
    for length in lengths:
        ends = np.searchsorted(way, way[begins] + length)
        begun, ended = begins[ends < len(way)], ends[ends < len(way)]
        moved = se3.inverse(true[begun]) @ true[ended]
        difference = se3.inverse(se3.inverse(found[begun]) @ found[ended]) @ moved
        errors.append(np.linalg.norm(difference[:, :3, 3], axis=1))
        over.append(np.full(len(begun), length))
    return np.concatenate(errors), np.concatenate(over)
