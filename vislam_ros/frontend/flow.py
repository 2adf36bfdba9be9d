# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Points followed from one image to the next, to about half a pixel, over long ways.

Pyramidal Lucas and Kanade as OpenCV has it, after Bouguet, *Pyramidal implementation of the
Lucas Kanade feature tracker* (2001), forward and back. It compares grey values as they are, so
the image before is first given the brightness and the contrast of the one now.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

# Pixels to a side that are compared, and halvings: the guess may be 11 * 2^3 / 2 = 44 px wrong.
_WINDOW, _LEVELS = (11, 11), 3
# Steps of a level, and the step [px] that is small enough.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.02)


def follow(
    before: Grey, now: Grey, points: Floats, guess: Floats, round_trip: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Find points of one image in the next.

    Parameters
    ----------
    before, now : ndarray of uint8, (H, W)
    points : ndarray of float32, (n, 2)
        In the image before.
    guess : ndarray of float32, (n, 2)
        Where they may be now.
    round_trip : float
        How far from where it was a point may come back to, pixels.

    Returns
    -------
    points : ndarray of float32, (n, 2)
        In the image now.
    found : ndarray of bool, (n,)
        Which of them were found, inside the image, and came back.
    """
    if not len(points):
        return points, np.zeros(0, bool)
    before = alike(before, now)
    there, forward = _lucas_kanade(before, now, points, guess)
    back, backward = _lucas_kanade(now, before, there, there + (points - guess))
    height, width = now.shape
    with np.errstate(invalid="ignore"):
        inside = np.all((there >= 0) & (there <= (width - 1, height - 1)), axis=1)
        returned = np.linalg.norm(back - points, axis=1) <= round_trip
    return there, forward & backward & inside & returned


def alike(image: Grey, other: Grey) -> Grey:
    """Image with the mean and the standard deviation of the grey values of another one."""
    (mean,), (spread,) = (value.ravel() for value in cv2.meanStdDev(image))
    (other_mean,), (other_spread,) = (value.ravel() for value in cv2.meanStdDev(other))
    if not (spread > 0 and other_spread > 0):
        return image
    values = (np.arange(256) - mean) * (other_spread / spread) + other_mean
    table = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def _lucas_kanade(
    before: Grey, now: Grey, points: Floats, guess: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    there, status, _ = cv2.calcOpticalFlowPyrLK(
        before,
        now,
        np.ascontiguousarray(points, np.float32),
        np.array(guess, np.float32, order="C"),
        winSize=_WINDOW,
        maxLevel=_LEVELS,
        criteria=_CRITERIA,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(there, np.float32), np.ravel(status) > 0
