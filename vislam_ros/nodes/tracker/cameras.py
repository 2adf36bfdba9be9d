# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two raw cameras on a body, from camera infos and extrinsics, in whatever order they come."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.ranges import MOUNT
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, Stream, check_range
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    LATCHED_QOS,
    LEFT_CAMERA,
    RIGHT_CAMERA,
    STATIC_TRANSFORMS,
    VIEW_QOS,
    Frames,
    Topic,
)
from vislam_ros.data.bags.stereo_rig import stereo_rig
from vislam_ros.data.images.bags.static_transforms import StaticTransforms, frame_name

HEARD_TRANSFORMS = replace(
    STATIC_TRANSFORMS,
    name=STATIC_TRANSFORMS.recorded,
    qos=LATCHED_QOS._replace(depth=VIEW_QOS.depth),
    stream=Stream.STATIC_TRANSFORMS,
)
"""The static transforms of all robots: each of several publishers keeps a last message, of which
a depth of one would hold the newest alone."""

_FIELDS = ("width", "height", "distortion_model", "d", "k", "r", "p")


class RawCameras:
    """Keeps the newest good message of each kind.

    Where the left camera is in the body its extrinsics tell, or else the chain of static
    transforms from the body's frame to that of the left camera info, as in bags.

    Parameters
    ----------
    frames : Frames
        Of the extrinsics; its base is where the chain begins.
    rectified : bool
        Whether the images are rectified already.
    extrinsics_come : callable, optional
        Tells whether somebody publishes extrinsics: then the transforms do not count.

    Attributes
    ----------
    rig : StereoRig or None
        What they say together, once all are there.
    transforms : StaticTransforms
        Whoever adds some has to :meth:`settle`.
    """

    def __init__(
        self,
        frames: Frames,
        *,
        rectified: bool,
        extrinsics_come: Callable[[], bool] = lambda: False,
    ):
        self.rig: StereoRig | None = None
        self._frames = frames
        self._rectified = rectified
        self._extrinsics_come = extrinsics_come
        self.transforms = StaticTransforms()
        self._messages: dict[Topic, Any] = {}
        self._known: dict[Topic, tuple[Any, ...]] = {}
        self._rig_of: tuple[Any, ...] = ()

    def missing(self) -> list[str]:
        """What has not come yet, by its topic."""
        infos = LEFT_CAMERA, RIGHT_CAMERA
        missing = [topic.name for topic in infos if topic not in self._messages]
        if self._T_body_left(self._messages) is None:
            where = EXTRINSICS.name
            if LEFT_CAMERA in self._messages and not self._extrinsics_come():
                frame = frame_name(self._messages[LEFT_CAMERA].header.frame_id)
                where += (
                    f", or {STATIC_TRANSFORMS.recorded} from {self._frames.base!r} to {frame!r}"
                )
            missing.append(where)
        return missing

    def add(self, topic: Topic, message: Any) -> bool:
        """Take a message of one of the three topics; tell whether the rig is another now.

        Raises
        ------
        RefusedMessage
            Where it is bad, or no pair with the others; then these hold on.
        """
        said = self._said(topic, message)
        if said == self._known.get(topic) and self.rig is not None:
            return False
        return self._settle({**self._messages, topic: message}, {**self._known, topic: said})

    def settle(self) -> bool:
        """Look at the transforms again; tell whether the rig is another now.

        Raises
        ------
        RefusedMessage
            Where the camera would be where no camera is.
        """
        return self._settle(self._messages, self._known)

    def _settle(self, messages: dict[Topic, Any], known: dict[Topic, tuple[Any, ...]]) -> bool:
        """Make the rig of messages, if it is another, and keep them."""
        T_body_left, rig = self._T_body_left(messages), None
        if T_body_left is not None:
            check_range(MOUNT, T_body_left[:3, 3])
        if LEFT_CAMERA in messages and RIGHT_CAMERA in messages:
            infos = messages[LEFT_CAMERA], messages[RIGHT_CAMERA]
            T = np.eye(4) if T_body_left is None else T_body_left
            rig = stereo_rig(*infos, T, rectified=self._rectified)
        self._messages, self._known = messages, known
        if T_body_left is None or rig is None:
            return False
        rig_of = T_body_left.tolist(), known[LEFT_CAMERA], known[RIGHT_CAMERA]
        changed, self._rig_of = rig_of != self._rig_of, rig_of
        self.rig = rig
        return changed

    def _T_body_left(self, messages: Mapping[Topic, Any]) -> NDArray[np.float64] | None:
        """Pose (4, 4) of the left camera in the body, None where nothing tells it yet."""
        if extrinsics := messages.get(EXTRINSICS):
            return se3.pose_matrix(*decoding.extrinsics(extrinsics, self._frames))
        if LEFT_CAMERA not in messages or self._extrinsics_come():
            return None
        frame = messages[LEFT_CAMERA].header.frame_id
        return self.transforms.pose(self._frames.base, frame)

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
