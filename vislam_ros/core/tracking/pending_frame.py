# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames of features that wait for their prediction or their camera."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.pixel_rectification import PixelRectification


@dataclass(frozen=True)
class PendingFrame:
    """Features of one stamp, as they came.

    Attributes
    ----------
    pass_number, stamp : int
        The stamp is nanoseconds.
    ids : ndarray of uint32, (n,)
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    noise : ndarray of float32, (n,), or None
        Standard deviation of each observation as its source states it, pixels.
    """

    pass_number: int
    stamp: int
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]
    noise: NDArray[np.float32] | None

    @property
    def weight(self) -> int:
        """What it counts as among those that wait: one, and one more for each thousand points."""
        return 1 + len(self.ids) // 1000

    def rectified(self, rectification: PixelRectification | None) -> "PendingFrame":
        """Frame of the rectified pair; None changes nothing."""
        if rectification is None:
            return self
        frame = rectification.frame(self.ids, self.pixels, self.noise)
        return PendingFrame(self.pass_number, self.stamp, *frame)


class PendingFrames(deque[PendingFrame]):
    """Those that wait, the first to come first.

    Parameters
    ----------
    most : int
        What they may weigh before no more are taken.
    """

    def __init__(self, most: int):
        super().__init__()
        self._most = most
        self._weight = 0

    def add(self, frame: PendingFrame) -> bool:
        """Append a frame; tell whether there was room for it."""
        if self._weight >= self._most:
            return False
        self.append(frame)
        self._weight += frame.weight
        return True

    def take(self) -> PendingFrame:
        """Take out the first frame."""
        frame = self.popleft()
        self._weight -= frame.weight
        return frame
