# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Left and right images and a gyroscope's samples, in whatever order they come, become pairs.

What comes out depends on the messages and not on which stream was the faster one: a pair waits for
its partner and for the samples that reach it, and goes on without these where they stay away.
"""

from collections import deque
from collections.abc import Callable
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, Stream
from vislam_ros.core.tracking.time_order import Passes
from vislam_ros.frontend.pair_tracker import Raw
from vislam_ros.nodes.settings import TrackerNodeSettings
from vislam_ros.nodes.tracker.gyroscope import Gyroscope

Array = NDArray[np.float64]

_SIDES = (Stream.LEFT_IMAGE, Stream.RIGHT_IMAGE)
# Steps whose median is the usual one.
_STEPS = 51


class _Image(NamedTuple):
    pass_number: int
    stamp: int
    image: Raw
    came_at: float


class ReadyPair(NamedTuple):
    """A pair whose turn is here.

    Attributes
    ----------
    stamp : int
        Of the left image, nanoseconds.
    left, right : tuple of ndarray and str
        Pixels and encoding.
    turn : ndarray, (3, 3), or None
        Rotation of the body since the last pair, where it is known.
    begins_pass : bool
        Whether it is the first of a pass, which has no pair before it.
    came_at : float
        When the later image came, in the seconds that it was given with.
    """

    stamp: int
    left: Raw
    right: Raw
    turn: Array | None
    begins_pass: bool
    came_at: float


class StereoStream:
    """Orders, pairs and holds images.

    Parameters
    ----------
    settings : TrackerNodeSettings
    refuse : callable
        Called with stream, reason and stamp (ns) of each message that is not to be used.

    Attributes
    ----------
    is_open : bool
        Whether pairs may come out: the cameras are known.
    without_turn : int
        Pairs whose turn was waited for in vain.
    """

    def __init__(
        self,
        settings: TrackerNodeSettings,
        refuse: Callable[[Stream, Refusal, int], object],
    ):
        self._settings = settings
        self._refuse = refuse
        self._passes = Passes(dict.fromkeys((*_SIDES, Stream.IMU), settings.time_jump), refuse)
        self._alone: dict[Stream, deque[_Image]] = {side: deque() for side in _SIDES}
        self._steps: deque[int] = deque(maxlen=_STEPS)
        self._newest_left: _Image | None = None
        self._pairs: deque[tuple[_Image, _Image]] = deque()
        self._gyroscopes: dict[int, Gyroscope] = {}
        self._waits = settings.gyroscope == "required"
        self._last: tuple[int, int] | None = None  # pass and stamp of the pair that came out last
        self.is_open = False
        self.without_turn = 0

    @property
    def waiting(self) -> int:
        """How many pairs wait."""
        return len(self._pairs)

    @property
    def refused_if_over(self) -> RefusalCounts:
        """What will be refused besides if nothing more comes."""
        over = self._passes.refused_if_over()
        for side, images in self._alone.items():
            for image in images:
                over.add(side, Refusal.UNPAIRED, image.stamp)
        waits_for = Refusal.NO_PREDICTION if self.is_open else Refusal.NO_CAMERA
        for left, _ in self._pairs:
            over.add(Stream.IMAGES, waits_for, left.stamp)
        return over

    def add_image(
        self, side: Stream, stamp: int, image: Raw, came_at: float = 0.0
    ) -> list[ReadyPair]:
        """Take an image of a side with its stamp (ns); return the pairs that became ready."""
        for number, believed, (pixels, came) in self._passes.enter(side, stamp, (image, came_at)):
            entered = _Image(number, believed, pixels, came)
            self._alone[side].append(entered)
            if side is Stream.LEFT_IMAGE:
                self._note_step(entered)
        self._pair()
        return self.advance()

    def add_angular_velocity(self, stamp: int, omega: Array) -> list[ReadyPair]:
        """Take an angular velocity (3,) at a stamp (ns); return the pairs that became ready."""
        for number, believed, value in self._passes.enter(Stream.IMU, stamp, omega):
            self._gyroscopes.setdefault(number, Gyroscope()).add(believed, value)
            self._waits = True
        return self.advance()

    def advance(self) -> list[ReadyPair]:
        """Return the pairs that are ready by now, in order."""
        ready = []
        while self._pairs and self.is_open:
            left, right = self._pairs[0]
            if not self._is_known(left):
                if len(self._pairs) <= self._settings.max_pending:
                    break
                # The gyroscope is silent: until it is heard again nothing waits for it.
                self._waits = False
                self.without_turn += len(self._pairs)
            self._pairs.popleft()
            ready.append(self._ready(left, right))
        while len(self._pairs) > self._settings.max_pending:
            left, _ = self._pairs.popleft()
            self._refuse(Stream.IMAGES, Refusal.NO_CAMERA, left.stamp)
        return ready

    def _note_step(self, left: _Image) -> None:
        before, self._newest_left = self._newest_left, left
        if before is not None and before.pass_number == left.pass_number:
            self._steps.append(left.stamp - before.stamp)

    @property
    def _tolerance(self) -> float:
        """How far stamps of one moment may lie apart, nanoseconds."""
        if self._settings.stamp_tolerance:
            return self._settings.stamp_tolerance * 1e9
        return median(self._steps) / 2 if self._steps else 0.0

    def _pair(self) -> None:
        """Pair images whose stamps are each other's nearest; give up those that have none."""
        lefts, rights = (self._alone[side] for side in _SIDES)
        while lefts and rights:
            left, right = lefts[0], rights[0]
            apart = abs(left.stamp - right.stamp)
            if left.pass_number != right.pass_number or apart > self._tolerance:
                self._give_up(_SIDES[left[:2] > right[:2]])
            elif _is_nearer(lefts, right, apart):
                self._give_up(Stream.LEFT_IMAGE)
            elif _is_nearer(rights, left, apart):
                self._give_up(Stream.RIGHT_IMAGE)
            else:
                self._pairs.append((lefts.popleft(), rights.popleft()))
        for side in _SIDES:
            while len(self._alone[side]) > self._settings.max_pending:
                self._give_up(side)

    def _give_up(self, side: Stream) -> None:
        self._refuse(side, Refusal.UNPAIRED, self._alone[side].popleft().stamp)

    def _is_known(self, left: _Image) -> bool:
        """Whether the turn up to an image is known, or will not be."""
        if not self._waits or self._last is None or self._last[0] != left.pass_number:
            return True
        gyroscope = self._gyroscopes.get(left.pass_number)
        pass_is_over = self._passes.number(Stream.IMU) > left.pass_number
        return pass_is_over or (gyroscope is not None and gyroscope.reaches(left.stamp))

    def _ready(self, left: _Image, right: _Image) -> ReadyPair:
        number, stamp = left.pass_number, left.stamp
        begins_pass = self._last is None or self._last[0] != number
        if begins_pass:
            self._gyroscopes = {n: g for n, g in self._gyroscopes.items() if n >= number}
        turn, gyroscope = None, self._gyroscopes.get(number)
        if gyroscope is not None:
            if self._last is not None and not begins_pass:
                turn = gyroscope.turn_between(self._last[1], stamp)
            gyroscope.forget_before(stamp)
        self._last = number, stamp
        came_at = max(left.came_at, right.came_at)
        return ReadyPair(stamp, left.image, right.image, turn, begins_pass, came_at)


def _is_nearer(images: deque[_Image], to: _Image, apart: int) -> bool:
    """Whether the second of some images is nearer to one of the other side than the first is."""
    return (
        len(images) > 1
        and images[1].pass_number == to.pass_number
        and abs(images[1].stamp - to.stamp) < apart
    )
