# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs feature stamps with predicted poses and gives the motion between two of them."""

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import LARGEST_GYRO_OFFSET, level_attitude
from vislam_ros.core.motion import (
    UNKNOWN_VELOCITY_VARIANCE,
    Increment,
    Part,
    measures_velocity,
    process_covariance,
)
from vislam_ros.core.settings import MotionSettings

Array = NDArray[np.float64]

# Samples of a sensor come as far apart as the two before, give or take; where it is more than this
# many times as far, at least one is missing.
_MISSING = 1.5


class PredictedPath:
    """Predicted poses of one pass, by stamp.

    Where the first of them is turned, the odometry frame is one that stands, such as a level one,
    and the map is to stand as it does; else that is only where the body was.

    But for that only increments are taken from it, so a lost prediction costs nothing but its
    share of process noise: the pose at its stamp is interpolated on SE(3) between its neighbours,
    whose own pose sums up all twists.

    Attributes
    ----------
    settings : MotionSettings
        May be replaced at any time; the noise of later increments is made by it.
    stands : bool or None
        Whether the odometry frame does; None before the first pose.
    """

    def __init__(self, settings: MotionSettings, *, stands: bool | None = None):
        self.settings = settings
        self.stands = stands
        self._first: tuple[int, Array] | None = None
        self._stamps: list[int] = []
        self._poses: list[Array] = []
        self._spans: list[int] = []  # for which the sample of a stamp stands [ns]
        self._velocity_known: list[bool] = []  # to the sample of a stamp
        self._interval = 0

    def add(self, stamp: int, T_odom_body: Array, *, velocity_known: bool = True) -> None:
        """Add a pose (4, 4) with a stamp (ns) later than all before.

        Where the velocity is not known, the pose tells the rotation alone.
        """
        if self._first is None:
            self._first = stamp, T_odom_body
            if self.stands is None:
                self.stands = not np.array_equal(T_odom_body[:3, :3], np.eye(3))
        interval = stamp - self._stamps[-1] if self._stamps else 0
        missing = interval > _MISSING * self._interval > 0
        self._spans.append(self._interval if missing else interval)
        self._interval = interval
        self._stamps.append(stamp)
        self._poses.append(T_odom_body)
        self._velocity_known.append(velocity_known)

    def begins_after(self, stamp: int) -> bool:
        """Tell whether a stamp (ns) lies before the first pose, which no later pose can mend."""
        return bool(self._stamps) and stamp < self._stamps[0]

    def reaches(self, stamp: int) -> bool:
        """Tell whether there is a pose at a stamp (ns) or after it."""
        return bool(self._stamps) and stamp <= self._stamps[-1]

    @property
    def end(self) -> int | None:
        """Stamp (ns) of the last pose; None where there is none."""
        return self._stamps[-1] if self._stamps else None

    def pose(self, stamp: int) -> Array:
        """Pose (4, 4) at a stamp (ns) inside the path."""
        after = bisect_left(self._stamps, stamp)
        if self._stamps[after] == stamp:
            return self._poses[after]
        begin, end = self._stamps[after - 1], self._stamps[after]
        fraction = (stamp - begin) / (end - begin)
        return se3.interpolate(self._poses[after - 1], self._poses[after], fraction)

    def start(self, stamp: int) -> Array:
        """Pose (4, 4) in which an estimate begins at a stamp (ns) inside the path.

        In its place and with the yaw 0, it stands as the body does in the odometry frame. What
        turned since the first pose no faster than a gyroscope's offset has not turned.
        """
        T = np.eye(4)
        if self.stands and self._first is not None:
            first, T_odom_body = self._first
            T_now = self.pose(stamp)
            turn = np.linalg.norm(se3.log_rotation(T_odom_body[:3, :3].T @ T_now[:3, :3]))
            if turn > LARGEST_GYRO_OFFSET * (stamp - first) * 1e-9:
                T_odom_body = T_now
            T[:3, :3] = level_attitude(T_odom_body[2, :3])
        return T

    def increment(self, begin: int, end: int, usual: float) -> Increment:
        """Motion between two stamps (ns) inside the path, with the noise of every twist in it.

        A sample of the twist counts once, at its own stamp, however many steps see the motion that
        it gave the prediction: before that stamp nothing of it was measured. Where a step has many
        samples, their mean is one for it, and for each usual step in a long one; one that reaches
        over the end of the step then counts for its share.

        Parameters
        ----------
        begin, end : int
        usual : float
            Duration of a usual step, seconds.
        """
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
        motions = [T]
        if len(poses) > 2:
            motions = [se3.inverse(a) @ b for a, b in itertools.pairwise(poses)]
        many = bisect_right(self._stamps, end) - bisect_right(self._stamps, begin) > 1
        parts = [
            part
            for (a, b), motion in zip(itertools.pairwise(stamps), motions, strict=True)
            for part in self._parts(a, b, motion, shares=many)
        ]
        if many:
            parts = merged(parts, usual)
        return Increment(T, (end - begin) * 1e-9, covariance, tuple(parts))

    def _parts(self, begin: int, end: int, motion: Array, *, shares: bool) -> Iterator[Part]:
        """Yield the parts of a stretch (ns) that lies between two neighbouring poses.

        A sample that is still to come counts where it ``shares``.
        """
        after = bisect_left(self._stamps, end)
        begins = self._stamps[after] - self._spans[after]
        span = 0
        if self._stamps[after] == end or shares:
            span = end - min(max(begins, begin), end)
        if silent := end - begin - span:
            yield Part(silent * 1e-9, None)
        if span:
            twist = se3.log(motion) / ((end - begin) * 1e-9)
            if not self._velocity_known[after]:
                twist[:3] = np.nan
            yield Part(span * 1e-9, twist)

    def _noise(self, begin: int, end: int) -> Array:
        """Noise of a stretch that lies between two neighbouring poses."""
        after = bisect_left(self._stamps, end)
        whole = self._stamps[after] - self._stamps[after - 1]
        W = process_covariance(self.settings, whole * 1e-9, (end - begin) / whole)
        if not self._velocity_known[after]:
            W[:3, :3] = UNKNOWN_VELOCITY_VARIANCE * ((end - begin) * 1e-9) ** 2 * np.eye(3)
        return W

    def forget_before(self, stamp: int) -> None:
        """Drop the poses that no stamp from this one (ns) on can need."""
        first = max(bisect_right(self._stamps, stamp) - 1, 0)
        for values in (self._stamps, self._poses, self._spans, self._velocity_known):
            del values[:first]


def merged(parts: Sequence[Part], usual: float) -> list[Part]:
    """Merge parts that were measured one after the other, up to a usual step's duration (s)."""
    result: list[Part] = []
    for is_measured, run in itertools.groupby(parts, lambda part: part.measured is not None):
        stretch = list(run)
        if not is_measured:
            result += stretch
            continue
        ends = np.cumsum([part.duration for part in stretch])
        steps = max(round(float(ends[-1]) / usual), 1)
        # A part belongs to the step in which its middle lies.
        middles = ends - 0.5 * np.array([part.duration for part in stretch])
        which = np.minimum((middles / ends[-1] * steps).astype(int), steps - 1)
        for step in np.unique(which):
            result.append(_mean([stretch[k] for k in np.flatnonzero(which == step)]))
    return result


def _mean(parts: Sequence[Part]) -> Part:
    """One part of many, with the twist that moves the body as they do."""
    if len(parts) == 1:
        return parts[0]
    motion, duration, velocity_known = np.eye(4), sum(part.duration for part in parts), True
    for part in parts:
        assert part.measured is not None
        velocity_known &= measures_velocity(part.measured)
        motion = motion @ se3.exp(part.duration * np.nan_to_num(part.measured))
    twist = se3.log(motion) / duration
    if not velocity_known:
        twist[:3] = np.nan
    return Part(duration, twist)
