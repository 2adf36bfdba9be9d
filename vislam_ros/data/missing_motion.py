# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples of the motion that were not measured: the NaN of a file, or of arrays that are given.

Where all velocities are NaN, a gyroscope alone tells the motion. Where some numbers are, their
samples are left out, as the nodes refuse such messages.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
Missing = NDArray[np.bool_]


def missing_samples(twists: Array, where: str) -> Missing:
    """Tell which samples (N,) of twists (N, 6) are to be left out.

    Raises
    ------
    VislamError
        Beginning with ``where``, where more are missing than there are.
    """
    no_velocity, no_turn = (
        np.asarray(np.isnan(part).any(axis=1)) for part in (twists[:, :3], twists[:, 3:])
    )
    if np.isnan(twists[:, :3]).all():
        no_velocity = np.zeros_like(no_turn)
    for missing, what, cure in (
        (no_turn, "angular velocities", "nothing else tells how the body turns"),
        (no_velocity, "velocities", "leave all of them out, and the gyroscope alone is taken"),
    ):
        if 2 * missing.sum() > len(twists):
            raise VislamError(
                f"{where}: {missing.sum()} of {len(twists)} {what} are NaN, more than are not: "
                f"{cure}"
            )
    return np.logical_or(no_turn, no_velocity)


def filled(twists: Array, missing: Missing) -> Array:
    """Twists (N, 6) with numbers between those beside them in place of missing samples (N,)."""
    rows, result = np.arange(len(twists)), twists.copy()
    for column in result.T:
        if not np.isnan(column).all():
            column[missing] = np.interp(rows[missing], rows[~missing], column[~missing])
    return result
