# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A frame of features that waits for its prediction or its camera."""

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
    """

    pass_number: int
    stamp: int
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]

    @property
    def weight(self) -> int:
        """What it counts as among those that wait: one, and one more for each thousand points."""
        return 1 + len(self.ids) // 1000

    def rectified(
        self, rectification: PixelRectification | None
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        """Ids (n,) and pixels (n, 4) of the rectified pair; None changes nothing."""
        if rectification is None:
            return self.ids, self.pixels
        return rectification.frame(self.ids, self.pixels)
