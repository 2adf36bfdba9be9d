# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From images as cameras give them to tracks, pair by pair: the same live and offline."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.frontend.grey import Grey, GreyStream
from vislam_ros.frontend.rectification import Rectification
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import StereoTracker, Tracked

Array = NDArray[np.float64]
#: Pixels (H, W) or (H, W, channels), 8 or 16 bits, and their encoding in ROS's words.
Raw = tuple[NDArray[Any], str]


class PairTracker:
    """Makes raw images grey, rectifies them, and follows points through them.

    Parameters
    ----------
    rig : StereoRig
    settings : TrackerSettings, optional

    Raises
    ------
    VislamError
        As :class:`~vislam_ros.frontend.rectification.Rectification` does.
    """

    def __init__(self, rig: StereoRig, settings: TrackerSettings | None = None):
        self._rectification = Rectification(rig)
        self._tracker = StereoTracker(self.camera, self.image_size, settings or TrackerSettings())
        # A camera's images are scaled alike, those of 16 bits.
        self._greys = GreyStream(), GreyStream()
        self._left: Grey | None = None

    @property
    def camera(self) -> StereoCamera:
        """Camera of the tracks: that of the rectified images."""
        return self._rectification.camera

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the rectified images, pixels."""
        return self._rectification.image_size

    @property
    def left(self) -> Grey | None:
        """Rectified left image (H, W) of the last pair, for a picture."""
        return self._left

    def change_settings(self, settings: TrackerSettings) -> None:
        """Take other settings from the next pair on."""
        self._tracker.change_settings(settings)

    def track(self, left: Raw, right: Raw, turn: Array | None = None) -> Tracked:
        """Take the next pair.

        Parameters
        ----------
        left, right : tuple of ndarray and str
            Pixels and encoding.
        turn : ndarray, (3, 3), optional
            Rotation of the body since the last pair, in the axes that it had then (see
            :func:`~vislam_ros.frontend.turns.turn_between`).

        Raises
        ------
        VislamError
            Where an image has another size than its camera, or an encoding that cannot be read.
        """
        greys = [stream.grey(*raw) for stream, raw in zip(self._greys, (left, right), strict=True)]
        self._left, rectified_right = self._rectification.rectify(greys[0], greys[1])
        R_camera_body = self.camera.T_camera_body[:3, :3]
        R_now_before = None if turn is None else R_camera_body @ turn.T @ R_camera_body.T
        return self._tracker.track(self._left, rectified_right, R_now_before)
