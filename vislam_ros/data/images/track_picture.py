# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the tracks in one image of a drive, as a PNG file."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.frontend.picture import Trails, captioned, drawn_tracks
from vislam_ros.frontend.tracker import Tracked


class TrackPicture:
    """Draws one of the pairs that it is told of.

    Parameters
    ----------
    number : int
        Which one, from 0.
    """

    def __init__(self, number: int):
        self._left_to_go = number
        self._trails = Trails()
        self._picture: NDArray[np.uint8] | None = None

    def add(self, left: NDArray[np.uint8], tracked: Tracked) -> None:
        """Take the next pair: its rectified left image (H, W), and what was seen in it."""
        if self._picture is not None and self._left_to_go < 0:
            return
        self._trails.add(tracked)
        self._left_to_go -= 1
        if self._left_to_go < 0:
            self._picture = drawn_tracks(left, tracked, self._trails)

    def write(self, path: Path) -> None:
        """Write it; an OutputError where that cannot be."""
        if self._picture is not None:
            _, data = cv2.imencode(".png", captioned(self._picture))
            replace_file(path, data.tobytes())
