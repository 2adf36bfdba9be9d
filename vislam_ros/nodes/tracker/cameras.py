# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two raw cameras on a body, from camera infos and extrinsics, in whatever order they come."""

from dataclasses import replace
from typing import Any

import numpy as np

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import EXTRINSICS, LEFT_CAMERA, RIGHT_CAMERA, Frames, Topic
from vislam_ros.data.bags.stereo_rig import stereo_rig

_FIELDS = ("width", "height", "distortion_model", "d", "k", "r", "p")


class RawCameras:
    """Keeps the newest good message of each kind.

    Parameters
    ----------
    frames : Frames
        Of the extrinsics.
    rectified : bool
        Whether the images are rectified already.

    Attributes
    ----------
    rig : StereoRig or None
        What they say together, once all are there.
    """

    def __init__(self, frames: Frames, *, rectified: bool):
        self.rig: StereoRig | None = None
        self._frames = frames
        self._rectified = rectified
        self._messages: dict[Topic, Any] = {}
        self._known: dict[Topic, tuple[Any, ...]] = {}

    def missing(self) -> list[str]:
        """Topics of which nothing usable has come yet."""
        return [topic.name for topic in CALIBRATION_TOPICS if topic not in self._messages]

    def add(self, topic: Topic, message: Any) -> bool:
        """Take a message of one of the three topics; tell whether the rig is another now.

        Raises
        ------
        RefusedMessage
            Where it is bad, or no pair with the others; then these hold on.
        """
        said = self._said(topic, message)
        if said == self._known.get(topic):
            return False
        messages = {**self._messages, topic: message}
        T_body_left, rig = np.eye(4), None
        if extrinsics := messages.get(EXTRINSICS):
            T_body_left = se3.pose_matrix(*decoding.extrinsics(extrinsics, self._frames))
        if LEFT_CAMERA in messages and RIGHT_CAMERA in messages:
            infos = messages[LEFT_CAMERA], messages[RIGHT_CAMERA]
            rig = stereo_rig(*infos, T_body_left, rectified=self._rectified)
        self._messages, self._known[topic] = messages, said
        if extrinsics is None or rig is None:
            return False
        self.rig = rig
        return True

    def _said(self, topic: Topic, message: Any) -> tuple[Any, ...]:
        """What a message says, to be compared; raises where it is bad by itself."""
        if topic is EXTRINSICS:
            position, quaternion = decoding.extrinsics(message, self._frames)
            return (*position.tolist(), *quaternion.tolist())
        decoding.projection(message)
        values = (getattr(message, name) for name in _FIELDS)
        return tuple(v if isinstance(v, int | str) else tuple(v) for v in values)


def sized(rig: StereoRig, left: tuple[int, int], right: tuple[int, int]) -> StereoRig:
    """Rig of images of some sizes (width, height), which camera infos need not tell.

    Raises
    ------
    RefusedMessage
        Where one tells another.
    """
    for name, camera, size in (("left", rig.left, left), ("right", rig.right, right)):
        if all(camera.image_size) and camera.image_size != size:
            raise RefusedMessage(
                Refusal.WRONG_SIZE,
                f"the {name} image has {size[0]} x {size[1]} pixels, and its camera info "
                f"{camera.image_size[0]} x {camera.image_size[1]}",
            )
    return replace(
        rig, left=replace(rig.left, image_size=left), right=replace(rig.right, image_size=right)
    )
