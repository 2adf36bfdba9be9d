# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stereo camera, from both camera infos and the extrinsics, in whatever order they come."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.decoding import Projection
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    LEFT_CAMERA,
    RECTIFIED_CALIBRATION,
    RIGHT_CAMERA,
    Frames,
    Topic,
)

Array = NDArray[np.float64]


def differences(before: StereoCamera, after: StereoCamera) -> str:
    """In what one camera differs from another, in words."""
    old, new = dataclasses.asdict(before), dataclasses.asdict(after)
    changes = [f"{name}: {old[name]} to {new[name]}" for name in old if old[name] != new[name]]
    return ", ".join(changes) or "intrinsics of the right camera"


CALIBRATION_TOPICS = (LEFT_CAMERA, RIGHT_CAMERA, EXTRINSICS)

RECTIFIED_RULES = tuple(
    (raw.name, rectified.name)
    for raw, rectified in zip(CALIBRATION_TOPICS, RECTIFIED_CALIBRATION, strict=True)
)
"""What slam_node is to hear in place of what, where a tracker makes its features: their cameras,
and not those of the images."""


class Calibration:
    """Keeps the newest good message of each kind.

    Attributes
    ----------
    camera : StereoCamera or None
        What they say together, once all are there and both cameras are a pair.
    rectification : PixelRectification or None
        What makes the features' pixels those of the camera, where they are not.
    image_size : tuple of int, (2,)
        Width and height of the left image, pixels; 0 x 0 where it is not known.
    """

    def __init__(self, frames: Frames):
        self.camera: StereoCamera | None = None
        self.rectification: PixelRectification | None = None
        self.image_size = (0, 0)
        self._frames = frames
        self._projections: dict[Topic, Projection] = {}
        self._pair: tuple[Projection, Projection] | None = None
        self._extrinsics: tuple[Array, Array] | None = None

    def missing(self) -> list[str]:
        """Topics of which nothing usable has come yet."""
        known = {*self._projections, *([EXTRINSICS] if self._extrinsics else [])}
        return [topic.name for topic in CALIBRATION_TOPICS if topic not in known]

    def add(self, topic: Topic, message: Any) -> StereoCamera | None:
        """Take a message of one of the three topics; return the camera if anything changed.

        Raises
        ------
        RefusedMessage
            Where it is bad by itself, or the newest camera infos are no pair.
        """
        if topic is EXTRINSICS:
            self._extrinsics = decoding.extrinsics(message, self._frames)
        else:
            self._projections[topic] = decoding.projection(message)
            left, right = (self._projections.get(side) for side in (LEFT_CAMERA, RIGHT_CAMERA))
            if left is not None and right is not None:
                decoding.pair(left, right)
                self._pair = left, right
        if self._pair is None or self._extrinsics is None:
            return None
        before = self.camera, self.rectification
        self.image_size = self._pair[0].image_size
        self.camera, self.rectification = decoding.stereo_camera(*self._pair, *self._extrinsics)
        return None if (self.camera, self.rectification) == before else self.camera
