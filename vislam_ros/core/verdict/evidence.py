# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of which the images tell the motion, beside what the twist says of them.

A few steps in a hundred are looked at, in pairs. What is wrong with a drive, such as inverted
extrinsics, is wrong alike at both steps of a pair, while the noise of its images and twists is
not: the two steps have no frame and no sample of the twist in common. So the product of their
errors has the mean of what is wrong alone, whatever the noise.
"""

import operator
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, image_points_of
from vislam_ros.core.motion import Increment, angular_twist
from vislam_ros.core.tracking.tracks import indices_of
from vislam_ros.core.verdict.image_motion import FEWEST_POINTS, ImageMotion, image_motion

Array = NDArray[np.float64]

REACH = 6
"""Steps before and after, of which a pair knows the twist, too."""

# Points of a step that are fitted: twice as many would tell its motion better than any twist does.
_MOST_POINTS = 24
# The steps of a pair are so far apart at least, and at most [ns], and have one between them. The
# frames are others by then, and so are the samples of a twist of 10 Hz; the motion is the same.
_APART, _FARTHEST = 150_000_000, 1_000_000_000
# Steps from one pair to the next: at first, and after so many pairs, to save time.
_FIRST_STRIDE, _FIRST_PAIRS, _STRIDE = 4, 12, 25
# Of more pairs than this every other one is dropped.
_MOST_PAIRS = 512
# Disparities that are smaller may be noise [px].
_CLEAR_DISPARITY = 2.0


class StepPair(NamedTuple):
    """Two steps, each as the images and as the twists have it.

    Attributes
    ----------
    stamp : int
        Of the later one's end, nanoseconds.
    tau : ndarray, (2,)
        Their durations, seconds.
    motion : ndarray, (2, 6)
        Of the camera over each, ``[rho; theta]`` in its own axes.
    metric : ndarray, (6, 6)
        Mean square of how far an error of such a motion moves the points, pixels.
    twists : ndarray, (2, 2 REACH + 1, 6)
        Of the body, from REACH steps before to REACH steps after; NaN where none was measured.
    """

    stamp: int
    tau: Array
    motion: Array
    metric: Array
    twists: Array


class Looks(NamedTuple):
    """What the steps that were looked at amount to.

    Attributes
    ----------
    rigid, loose : int
        Steps whose points move as those of one scene, and those whose points do not.
    positive, negative : int
        Disparities that are clearly one or the other.
    """

    rigid: int = 0
    loose: int = 0
    positive: int = 0
    negative: int = 0

    def plus(self, other: "Looks") -> "Looks":
        """Sum of the two."""
        return Looks(*map(operator.add, self, other))


class _Half:
    """A step of a pair; the twists that follow it are still to come."""

    def __init__(self, stamp: int, tau: float, motion: ImageMotion, twists: list[Array]):
        self.stamp = stamp
        self.tau = tau
        self.motion = motion
        self.twists = twists

    @property
    def is_whole(self) -> bool:
        return len(self.twists) == 2 * REACH + 1


class Evidence:
    """Gathers pairs of steps, within bounds of time and memory.

    Attributes
    ----------
    looks : Looks
        Of all steps.
    """

    def __init__(self) -> None:
        self.looks = Looks()
        self._pairs: list[StepPair] = []
        self._recent: deque[StepPair] = deque(maxlen=_MOST_PAIRS // 4)
        self._recent_looks: deque[tuple[int, Looks]] = deque(maxlen=_MOST_PAIRS // 2)
        self._kept, self._gathered = 1, 0
        self._count, self._next = 0, 1
        self._first: _Half | None = None
        self._open: list[tuple[_Half, _Half]] = []
        self._latest: deque[Array] = deque(REACH * [np.full(6, np.nan)], maxlen=REACH + 1)
        self._before: tuple[NDArray[np.uint32], NDArray[np.float32]] | None = None
        self._start: Array = np.eye(4)

    @property
    def gathered(self) -> int:
        """Number of pairs so far."""
        return self._gathered

    def pairs(self, since: int | None = None) -> Sequence[StepPair]:
        """Pairs of the whole drive, evenly spread; or the latest ones, since a stamp (ns)."""
        if since is None:
            return self._pairs
        return [pair for pair in self._recent if pair.stamp >= since]

    def looks_since(self, since: int) -> Looks:
        """What the latest steps amount to, since a stamp (ns)."""
        total = Looks()
        for stamp, looks in self._recent_looks:
            if stamp >= since:
                total = total.plus(looks)
        return total

    def add(
        self,
        stamp: int,
        ids: NDArray[np.uint32],
        pixels: NDArray[np.float32],
        increment: Increment,
        camera: StereoCamera,
        *,
        frozen: bool,
    ) -> None:
        """Take a step (its end's stamp in ns), its frame and its motion as it was predicted."""
        before, self._before = self._before, (ids, pixels)
        self._count += 1
        twist = _twist_of(increment)
        self._latest.append(twist)
        first = self._first
        if first is not None or self._open:
            self._take_twist(twist)
        if first is not None:
            apart = stamp - first.stamp
            if apart > _FARTHEST:
                self._first, self._next = None, self._count
            elif apart < _APART or self._count < self._next + 2:
                return
        elif self._count < self._next:
            return
        if before is None or frozen or not increment.duration:
            return
        motion = self._look(stamp, before, (ids, pixels), camera)
        if motion is None:
            return
        half = _Half(stamp, increment.duration, motion, list(self._latest))
        if self._first is None:
            self._first, self._next = half, self._count
        else:
            self._open.append((self._first, half))
            self._first = None
            few = self._gathered < _FIRST_PAIRS
            self._next += _FIRST_STRIDE if few else _STRIDE

    def _take_twist(self, twist: Array) -> None:
        if self._first is not None and not self._first.is_whole:
            self._first.twists.append(twist)
        for pair in self._open:
            for half in pair:
                if not half.is_whole:
                    half.twists.append(twist)
        while self._open and self._open[0][1].is_whole:
            self._keep(*self._open.pop(0))

    def _look(
        self,
        stamp: int,
        before: tuple[NDArray[np.uint32], NDArray[np.float32]],
        after: tuple[NDArray[np.uint32], NDArray[np.float32]],
        camera: StereoCamera,
    ) -> ImageMotion | None:
        """Motion of the images between two frames, where they tell it."""
        if min(len(before[0]), len(after[0])) < FEWEST_POINTS:
            return None
        old, new, positive, negative = _common_points(*before, *after)
        if len(old) < FEWEST_POINTS:
            return None
        motion = image_motion(camera, old, new, self._start)
        looks = Looks(int(motion.is_one), int(not motion.is_one), positive, negative)
        self.looks = self.looks.plus(looks)
        self._recent_looks.append((stamp, looks))
        self._start = motion.T_new_old
        if motion.is_one:
            return motion
        # Another try at once would cost as much again at every step.
        self._next = self._count + (_FIRST_STRIDE if self._first is None else 0)
        return None

    def _keep(self, first: _Half, second: _Half) -> None:
        halves = (first, second)
        metric = 0.5 * (first.motion.metric + second.motion.metric)
        twists = np.array([half.twists for half in halves])
        if np.isnan(twists[:, REACH, :3]).all():
            metric = _of_rotation(metric)
            twists[..., :3] = 0.0
        pair = StepPair(
            second.stamp,
            np.array([half.tau for half in halves]),
            np.array([half.motion.xi for half in halves]),
            metric,
            twists,
        )
        self._recent.append(pair)
        if self._gathered % self._kept == 0:
            self._pairs.append(pair)
        self._gathered += 1
        if len(self._pairs) > _MOST_PAIRS:
            self._pairs = self._pairs[::2]
            self._kept *= 2


def _of_rotation(metric: Array) -> Array:
    """Metric A (6, 6) of the rotation alone, whatever translation fits: A's Schur complement."""
    rho, theta = slice(0, 3), slice(3, 6)
    result = np.zeros((6, 6))
    free = np.linalg.pinv(metric[rho, rho])
    result[theta, theta] = metric[theta, theta] - metric[theta, rho] @ free @ metric[rho, theta]
    return result


def _common_points(
    ids_before: NDArray[np.uint32],
    before: NDArray[np.float32],
    ids_after: NDArray[np.uint32],
    after: NDArray[np.float32],
) -> tuple[Array, Array, int, int]:
    """Image points (n, 3) of the tracks that two frames have in common, evenly chosen.

    With them come the numbers of those whose disparity is clearly positive, and negative.
    """
    places = indices_of(ids_after.astype(np.int64), ids_before.astype(np.int64))
    (common,) = np.nonzero(places >= 0)
    n = min(len(common), _MOST_POINTS)
    if n < len(common):
        common = common[-(-np.arange(n) * len(common) // n)]  # rounded up
    points_before = image_points_of(before[places[common]])
    points_after = image_points_of(after[common])
    disparity = points_after[:, 0] - points_after[:, 1]
    positive, negative = disparity > _CLEAR_DISPARITY, disparity < -_CLEAR_DISPARITY
    return points_before, points_after, int(positive.sum()), int(negative.sum())


def _twist_of(increment: Increment) -> Array:
    """Mean twist (6,) over a step as it was predicted; NaN as far as nothing was measured."""
    parts = increment.parts
    if not increment.measures_velocity:
        return angular_twist(se3.log_rotation(increment.T[:3, :3]) / increment.duration)
    if len(parts) == 1 and parts[0].measured is not None:
        return parts[0].measured
    if not increment.duration:
        return np.full(6, np.nan)
    return np.asarray(se3.log(increment.T) / increment.duration)
