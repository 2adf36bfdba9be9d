# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reference poses of whatever world, as the truth of a drive in images."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]


def from_first_pose(
    stamps: NDArray[np.int64], T_world_body: Array, frames: NDArray[np.int64]
) -> Trajectory | None:
    """Reference poses in the time of some frames, seen from the first of them.

    Parameters
    ----------
    stamps : ndarray of int64, (n,)
        Nanoseconds, strictly increasing.
    T_world_body : ndarray, (n, 4, 4)
    frames : ndarray of int64, (T,)
        Stamps of the frames, increasing.

    Returns
    -------
    Trajectory or None
        None where no pose lies in their time.
    """
    inside = (stamps >= frames[0]) & (stamps <= frames[-1])
    if not inside.any():
        return None
    poses = T_world_body[inside]
    return Trajectory.from_matrices(stamps[inside], se3.inverse(poses[0]) @ poses)


def of_another_body(truth: Trajectory, T_body_other: Array) -> Trajectory:
    """Truth of another body that is fixed to this one, in its own first pose's frame."""
    poses = truth.T_world_body @ T_body_other
    return Trajectory.from_matrices(truth.stamps, se3.inverse(poses[0]) @ poses)
