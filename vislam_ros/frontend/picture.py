# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the tracks in the left image: where each point is, was, and how far away."""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.frontend.tracker import Tracked

Grey = NDArray[np.uint8]

# Frames that a trail reaches back, and fractions of a pixel in which OpenCV draws, as a shift.
_LONGEST, _SHIFT = 10, 3
# The palette's shades of the farthest and the nearest point: its ends are nearly black.
_FAR, _NEAR = 25, 235
# What the marks mean: shade, whether filled, and words.
_CAPTION = (
    (_NEAR, True, "near"),
    (_FAR, True, "far"),
    (130, True, "followed, with its trail"),
    (130, False, "new"),
)
_CAPTION_HEIGHT, _CAPTION_WIDTH = 24, 480  # pixels


class Trails:
    """Where the points of the last frames were.

    Parameters
    ----------
    longest : int
        Frames that a trail reaches back.
    """

    def __init__(self, longest: int = _LONGEST):
        self._frames: deque[tuple[NDArray[np.uint32], NDArray[np.float32]]] = deque(maxlen=longest)

    def add(self, tracked: Tracked) -> None:
        """Take what a frame shows; a repeated one shows nothing new."""
        if not tracked.repeated:
            self._frames.append((tracked.ids, tracked.pixels[:, :2]))

    def of(self, ids: NDArray[np.uint32]) -> list[NDArray[np.float32]]:
        """Places (k, 2) of each of these points in the last frames, the newest first."""
        trails: list[list[NDArray[np.float32]]] = [[] for _ in ids]
        there = np.arange(len(ids))
        for known, places in reversed(self._frames):
            _, rows, columns = np.intersect1d(ids[there], known, return_indices=True)
            there = there[rows]
            for i, column in zip(there.tolist(), columns.tolist(), strict=True):
                trails[i].append(places[column])
        return [np.array(trail, np.float32).reshape(-1, 2) for trail in trails]


def drawn_tracks(left: Grey, tracked: Tracked, trails: Trails | None = None) -> Grey:
    """Draw tracks into an image.

    Parameters
    ----------
    left : ndarray of uint8, (H, W)
        The rectified left image.
    tracked : Tracked
        What the tracker gave for it.
    trails : Trails, optional
        That have heard of it and of the frames before.

    Returns
    -------
    ndarray of uint8, (H, W, 3)
        BGR. Red is near and blue far, as the frame's disparities go; a ring is a
        point without a trail.
    """
    picture = cv2.cvtColor(left, cv2.COLOR_GRAY2BGR)
    if not len(tracked.ids):
        return np.asarray(picture, np.uint8)
    disparities = np.maximum(tracked.pixels[:, 0] - tracked.pixels[:, 2], 0)
    # The logarithm, as the eye sees distances: half of them would be blue otherwise.
    nearness = np.log1p(disparities)
    nearness -= nearness.min()
    nearness /= max(float(nearness.max()), 1e-6)
    colours = _colours(np.rint(_FAR + (_NEAR - _FAR) * nearness))
    paths = trails.of(tracked.ids) if trails else [place[None] for place in tracked.pixels[:, :2]]
    for path, place, colour in zip(paths, tracked.pixels[:, :2], colours, strict=True):
        corners = np.rint(path * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [corners], False, colour, 1, cv2.LINE_AA, _SHIFT)
        middle = np.rint(place * (1 << _SHIFT)).astype(int).tolist()
        filled = cv2.FILLED if len(path) > 1 else 1
        cv2.circle(picture, middle, 3 << _SHIFT, colour, filled, cv2.LINE_AA, _SHIFT)
    return np.asarray(picture, np.uint8)


def captioned(picture: Grey) -> Grey:
    """Picture (H, W, 3) of tracks with a line below that says what its marks mean."""
    width = picture.shape[1]
    scale = min(1.0, width / _CAPTION_WIDTH)
    height = round(_CAPTION_HEIGHT * scale)
    line = np.full((height, width, 3), 255, np.uint8)
    x, middle = 0.5 * height, height // 2
    colours = _colours(np.array([shade for shade, *_ in _CAPTION]))
    for (_, is_filled, words), colour in zip(_CAPTION, colours, strict=True):
        filled = cv2.FILLED if is_filled else 1
        cv2.circle(line, (round(x), middle), max(2, round(4 * scale)), colour, filled, cv2.LINE_AA)
        font = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * scale
        (length, high), _ = cv2.getTextSize(words, *font, 1)
        place = (round(x + 10 * scale), middle + high // 2)
        cv2.putText(line, words, place, *font, (0, 0, 0), 1, cv2.LINE_AA)
        x += length + 40 * scale
    return np.concatenate([picture, line])


def _colours(shades: NDArray[np.float64] | NDArray[np.int64]) -> list[list[float]]:
    """Colours of shades (n,), 0 to 255, of the palette."""
    palette = cv2.applyColorMap(shades.astype(np.uint8), cv2.COLORMAP_TURBO)
    return palette.astype(float).reshape(-1, 3).tolist()
