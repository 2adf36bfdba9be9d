# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether an image is the last one over again, as a camera or a driver gives it that fell behind.

The noise of a sensor changes most grey values even where nothing moves: of a standing camera's
pixels a fifth stays equal, and two thirds after strong denoising. A copy has them all, but for
what is written over it, such as a time.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]

# Share of equal pixels from which on an image is a copy: between the two thirds and all.
_COPIED = 0.9
# Every so many pixels are looked at, along both axes.
_EVERY = 3
# Grey values that are no limit of the sensor: black and white repeat themselves honestly.
_BLACK, _WHITE = 4, 250


def is_repeated(image: Grey, before: Grey) -> bool:
    """Tell whether an image (H, W) repeats the one before.

    What is all black or all white says nothing, and is not called repeated.
    """
    now, then = image[::_EVERY, ::_EVERY], before[::_EVERY, ::_EVERY]
    telling = cv2.countNonZero(cv2.inRange(now, (_BLACK,), (_WHITE,)))
    if not telling:
        return False
    differ = (now != then) & (now >= _BLACK) & (now <= _WHITE)
    return int(np.count_nonzero(differ)) <= (1 - _COPIED) * telling
