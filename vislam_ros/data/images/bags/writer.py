# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing a drive in images as a bag that the live graph is sent: images, cameras and motion."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.bags.encoding import DriveMessages, Stream, in_order
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    EXTRINSICS,
    LEFT_CAMERA,
    LEFT_IMAGE,
    RIGHT_CAMERA,
    RIGHT_IMAGE,
    STATIC_TRANSFORMS,
    Frames,
    Topic,
)
from vislam_ros.data.bags.writer import Contents, write_contents
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.images.stereo_images import RawImage, StereoImages, StereoPair
from vislam_ros.data.images.told_rig import ToldRig
from vislam_ros.errors import VislamError

_LATCHED = (LEFT_CAMERA, RIGHT_CAMERA, EXTRINSICS, STATIC_TRANSFORMS)
# Only its motion is written; what it says of a camera is not.
_NO_CAMERA = StereoCamera(1.0, 1.0, 0.0, 0.0, 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def write_image_bag(
    images: StereoImages,
    output: Path,
    *,
    source: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    force: bool = False,
    frames: Frames = DEFAULT_FRAMES,
    progress: Progress | None = None,
) -> None:
    """Write images and their motion as a bag directory, one pair in memory at a time.

    Parameters
    ----------
    images : StereoImages
        With their motion.
    output, source, settings, force, frames, progress
        As of :func:`vislam_ros.data.bags.writer.write_bag`.

    Raises
    ------
    VislamError
        Where nothing tells the motion or the times, an image cannot be read, or the output
        exists or cannot be written.
    """
    motion_of = motion_drive(images)
    store = get_typestore(Stores.ROS2_JAZZY)
    messages = DriveMessages(motion_of, frames, store)
    told = ToldRig.of(images.rig)
    reading = _Reading(messages, images)
    streams: list[Stream] = [
        *messages.streams(),
        (LEFT_IMAGE, images.stamps, reading.left),
        (RIGHT_IMAGE, images.stamps, reading.right),
    ]

    def latched(stamp: int) -> list[tuple[Topic, Any]]:
        return [
            (LEFT_CAMERA, messages.camera_info(stamp, **asdict(told.left))),
            (RIGHT_CAMERA, messages.camera_info(stamp, **asdict(told.right))),
            *messages.extrinsics(stamp, told.position_body_left, told.quaternion_body_left),
        ]

    contents = Contents(
        name=images.name,
        notes=images.notes,
        counts={"pairs": len(images), "twists": len(motion_of.twist_stamps)},
        topics=dict.fromkeys(_LATCHED, 1) | {topic: len(stamps) for topic, stamps, _ in streams},
        messages=in_order(images.name, latched, streams, store),
    )
    write_contents(
        contents, store, output, source=source, settings=settings, force=force, progress=progress
    )


def motion_drive(images: StereoImages) -> Drive:
    """Drive of images and their motion, with frames that hold no features, and without a camera.

    Raises
    ------
    VislamError
        Where nothing tells the motion or the times.
    """
    motion = images.known_motion()
    return Drive(
        name=images.name,
        camera=_NO_CAMERA,
        image_size=images.rig.left.image_size,
        twist_stamps=motion.stamps,
        twists=motion.twists,
        accelerations=motion.accelerations,
        feature_stamps=images.stamps,
        offsets=np.zeros(len(images) + 1, dtype=np.int64),
        ids=np.empty(0, dtype=np.uint32),
        pixels=np.empty((0, 4), dtype=np.float32),
        ground_truth=images.ground_truth,
        notes=images.notes,
    )


class _Reading:
    """Reads pairs one after the other, as their left and then their right images are asked for."""

    def __init__(self, messages: DriveMessages, images: StereoImages):
        self._messages = messages
        self._pairs: Iterator[StereoPair] = images.pairs()
        self._pair: StereoPair | None = None

    def left(self, _k: int) -> Any:
        self._pair = next(self._pairs)
        return self._message(self._pair.stamp, self._pair.left)

    def right(self, _k: int) -> Any:
        if self._pair is None:
            raise VislamError("the right image was asked for before the left one")
        return self._message(self._pair.stamp, self._pair.right)

    def _message(self, stamp: int, image: RawImage) -> Any:
        return self._messages.image(stamp, *image)
