# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""New points to follow: corners that are far from those followed, spread over the image.

Corners are those of Shi and Tomasi, *Good features to track* (1994), found in the image at half
its size: their detail is then of the size of the patches that are compared, and the time a third.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.tracking.spread import best_spread

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

# Corners are taken down to this share of the strongest one: shadows have theirs, too. What is
# noise finds no partner in the other image.
_WEAKEST = 0.002
# Pixels of the half image over which a corner is weighed; a patch of 15 is 7 of them.
_BLOCK = 5
# Corners to choose from, for each that is wanted.
_CHOICE = 4
# A corner at the rim has no neighbourhood [px of the half image].
_RIM = 4


def new_corners(image: Grey, there: Floats, wanted: int, most: int) -> Floats:
    """Find corners beside the points that are there.

    Parameters
    ----------
    image : ndarray of uint8, (H, W)
    there : ndarray of float32, (m, 2)
        Points that are followed already.
    wanted : int
        How many new ones.
    most : int
        Points that the whole image is to hold; their distance follows from it.

    Returns
    -------
    ndarray of float32, (n, 2)
        At most ``wanted``, the best spread of what there is.
    """
    height, width = image.shape
    if wanted <= 0 or min(height, width) <= 4 * _RIM:
        return np.empty((0, 2), np.float32)
    small = cv2.pyrDown(image)
    # Half the side of a cell, when each point has a cell of its own; a quarter in the half image.
    distance = max(math.sqrt(height * width / most) / 4, 1.0)
    free = np.zeros(small.shape, np.uint8)
    free[_RIM:-_RIM, _RIM:-_RIM] = 255
    for x, y in np.rint(there / 2).astype(int).tolist():
        cv2.circle(free, (x, y), math.ceil(distance), 0, -1)
    found: Any = cv2.goodFeaturesToTrack(
        small, _CHOICE * most, _WEAKEST, distance, mask=free, blockSize=_BLOCK
    )
    if found is None:
        return np.empty((0, 2), np.float32)
    corners = 2 * np.asarray(found, np.float32).reshape(-1, 2)
    if len(corners) <= wanted:
        return corners
    chosen = best_spread(np.tile(corners, 2), wanted, np.tile(there, 2))
    return corners[chosen]
