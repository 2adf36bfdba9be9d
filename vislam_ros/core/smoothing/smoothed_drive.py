# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the last frame of a drive lets one know of the whole of it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.smoothing.backward import smooth
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.core.tracking.tracked_frame import Keys
from vislam_ros.core.tracking.tracks import indices_of, is_member

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SmoothedDrive:
    """Smoothed poses and the exact map.

    Attributes
    ----------
    stamps : ndarray of int64, (T,)
        Nanoseconds.
    positions, quaternions : ndarray, (T, 3), (T, 4)
        Body in the map; x, y, z, w.
    covariances : ndarray, (T, 6, 6)
        Of the pose errors ``[rho; theta]`` on the right.
    landmarks : LandmarkMap
        As the filter over all landmarks ever seen has them.
    """

    stamps: NDArray[np.int64]
    positions: Array
    quaternions: Array
    covariances: Array
    landmarks: LandmarkMap

    def __repr__(self) -> str:
        return f"<SmoothedDrive: {len(self.stamps)} poses, {len(self.landmarks)} landmarks>"


def smoothed_drive(
    tape: Tape, stamps: list[int], keys: Keys, landmarks: LandmarkMap
) -> SmoothedDrive:
    """Smooth what a tape has recorded.

    Parameters
    ----------
    tape : Tape
    stamps : list of int
        Of the tape's pose marks, nanoseconds.
    keys : ndarray of int64, (M,)
        Of the landmarks.
    landmarks : LandmarkMap
        As the filter has them. Those that it still tracks are exact there; the tape knows the
        others.
    """
    smoothed = smooth(tape)
    # What was marginalized without a position is on the tape and not in the map.
    mapped = is_member(smoothed.keys, keys)
    slots = indices_of(smoothed.keys[mapped], keys)
    positions, covariances = landmarks.positions.copy(), landmarks.covariances.copy()
    positions[slots] = smoothed.positions[mapped]
    covariances[slots] = smoothed.covariances[mapped]
    return SmoothedDrive(
        stamps=np.array(stamps, dtype=np.int64),
        positions=smoothed.poses[:, :3, 3],
        quaternions=se3.quaternion_from_rotation(smoothed.poses[:, :3, :3]),
        covariances=smoothed.pose_covariances,
        landmarks=replace(landmarks, positions=positions, covariances=covariances),
    )
