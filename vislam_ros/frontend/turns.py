# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a body has turned from one moment to another, as a gyroscope tells it."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


def turn_between(stamps: Stamps, omegas: Array, begin: int, end: int) -> Array | None:
    """Rotation (3, 3) of the body from one stamp to a later one, in the axes of the first.

    A sample stands for the time that ends at its stamp, so the last one may reach beyond ``end``.

    Parameters
    ----------
    stamps : ndarray of int64, (N,)
        Nanoseconds, strictly increasing.
    omegas : ndarray, (N, 3)
        Angular velocities in the body, radians a second.
    begin, end : int
        Nanoseconds.

    Returns
    -------
    ndarray or None
        None where the samples do not reach over the whole time.
    """
    if not len(stamps) or begin < stamps[0] or end > stamps[-1]:
        return None
    first = int(np.searchsorted(stamps, begin, side="right"))
    last = int(np.searchsorted(stamps, end, side="left"))
    knots = np.concatenate([[begin], stamps[first:last], [end]])
    durations = np.diff(knots) * 1e-9
    turns = se3.exp_rotation(durations[:, None] * omegas[first : last + 1])
    R = np.eye(3)
    for turn in turns:
        R = R @ turn
    return R
