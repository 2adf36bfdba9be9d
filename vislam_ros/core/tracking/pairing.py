# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs feature stamps with predicted poses and gives the motion between two of them."""

from bisect import bisect_left, bisect_right

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment, process_covariance
from vislam_ros.core.settings import MotionSettings

Array = NDArray[np.float64]


class PredictedPath:
    """Predicted poses of one pass, by stamp.

    Only increments are ever taken from it, so a lost prediction costs nothing but its share of
    process noise: the pose at its stamp is interpolated on SE(3) between its neighbours, whose
    own pose sums up all twists.
    """

    def __init__(self, settings: MotionSettings):
        self._settings = settings
        self._stamps: list[int] = []
        self._poses: list[Array] = []

    def add(self, stamp: int, T_odom_body: Array) -> None:
        """Add a pose (4, 4) with a stamp (ns) later than all before."""
        self._stamps.append(stamp)
        self._poses.append(T_odom_body)

    def begins_after(self, stamp: int) -> bool:
        """Tell whether a stamp (ns) lies before the first pose, which no later pose can mend."""
        return bool(self._stamps) and stamp < self._stamps[0]

    def reaches(self, stamp: int) -> bool:
        """Tell whether there is a pose at a stamp (ns) or after it."""
        return bool(self._stamps) and stamp <= self._stamps[-1]

    def pose(self, stamp: int) -> Array:
        """Pose (4, 4) at a stamp (ns) inside the path."""
        after = bisect_left(self._stamps, stamp)
        if self._stamps[after] == stamp:
            return self._poses[after]
        begin, end = self._stamps[after - 1], self._stamps[after]
        fraction = (stamp - begin) / (end - begin)
        return se3.interpolate(self._poses[after - 1], self._poses[after], fraction)

    def increment(self, begin: int, end: int) -> Increment:
        """Motion between two stamps (ns) inside the path, with the noise of every twist in it."""
        inner = range(bisect_right(self._stamps, begin), bisect_left(self._stamps, end))
        stamps = [begin, *(self._stamps[k] for k in inner), end]
        poses = [self.pose(stamp) for stamp in (begin, end)]
        poses[1:1] = [self._poses[k] for k in inner]
        covariance = self._noise(stamps[0], stamps[1])
        for k in range(1, len(stamps) - 1):
            transition = se3.adjoint(se3.inverse(poses[k + 1]) @ poses[k])
            noise = self._noise(stamps[k], stamps[k + 1])
            covariance = transition @ covariance @ transition.T + noise
        T = se3.inverse(poses[0]) @ poses[-1]
        return Increment(T, (end - begin) * 1e-9, covariance)

    def _noise(self, begin: int, end: int) -> Array:
        """Noise of a stretch that lies between two neighbouring poses."""
        after = bisect_left(self._stamps, end)
        whole = self._stamps[after] - self._stamps[after - 1]
        return process_covariance(self._settings, whole * 1e-9, (end - begin) / whole)

    def forget_before(self, stamp: int) -> None:
        """Drop the poses that no stamp from this one (ns) on can need."""
        first = max(bisect_right(self._stamps, stamp) - 1, 0)
        del self._stamps[:first], self._poses[:first]
