# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags with images: both cameras' topics, their camera infos, motion and extrinsics.

The body is the frame of the twists or of the IMU, with its axes as they are recorded. A bag is
read twice: once for the stamps and all that is not images, and then for the images.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.image_messages import image
from vislam_ros.data.bags.layout import (
    COMPRESSED_IMAGE,
    LEFT_CAMERA,
    LEFT_IMAGE,
    RIGHT_CAMERA,
    RIGHT_IMAGE,
    Frames,
    Topic,
)
from vislam_ros.data.bags.stereo_rig import stereo_rig
from vislam_ros.data.images.bags.motion import RecordedMotion
from vislam_ros.data.images.bags.topics import ImageTopics, find_topics, has_images
from vislam_ros.data.images.given_motion import GivenMotion
from vislam_ros.data.images.image_file import decoded
from vislam_ros.data.images.pairing import half_a_period, pair_stamps, pairing_notes
from vislam_ros.data.images.reference_poses import from_first_pose
from vislam_ros.data.images.stereo_images import RawImage, StereoImages
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.errors import VislamError

Stamps = NDArray[np.int64]

_SIDES = (LEFT_IMAGE, RIGHT_IMAGE)
# Both images of a pair lie close to each other in a bag; those that wait are held [bytes].
_MOST_WAITING = 1 << 28


def matches(path: Path, topics: Mapping[str, str] | None = None) -> bool:
    """Whether a bag is one of images, and not of features.

    Parameters
    ----------
    path : Path
    topics : mapping of str to str, optional
        The bag's name for a topic by ours; a bag that has features is one of images if its images
        are named here.

    Raises
    ------
    VislamError
        Where it cannot be opened.
    """
    with BagMessages(path) as bag:
        return has_images(_msgtypes(bag), topics)


def read(
    path: Path,
    *,
    frames: Frames,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
    needs_extrinsics: bool = True,
) -> StereoImages:
    """Open a bag with images.

    Parameters
    ----------
    path : Path
    frames : Frames
        Of twists and extrinsics on the topics of this package.
    topics, namespace : mapping of str to str, str, optional
        What the bag calls them, see :func:`vislam_ros.data.bags.reader.read_passes`.
    needs_extrinsics : bool
        Whether the bag must tell where the camera is on the body.

    Raises
    ------
    VislamError
        Naming the topic, and what is wrong with it.
    """
    with BagMessages(path) as bag:
        found = find_topics(path, _msgtypes(bag), topics, namespace)
        stamps: dict[str, set[int]] = {found.names[side]: set() for side in _SIDES}
        infos: dict[str, Any] = {}
        cameras = {found.names[side] for side in (LEFT_CAMERA, RIGHT_CAMERA)}
        motion = RecordedMotion(path, found.names, frames)
        for connection, _, data in bag.messages(set(found.names.values())):
            if connection.topic in stamps:
                stamps[connection.topic].add(_header_stamp(path, connection.topic, data))
            elif connection.topic not in cameras:
                motion.add(bag, connection, data)
            elif connection.topic not in infos:
                infos[connection.topic] = _decoded_message(path, bag, connection, data)
    left_info = infos.get(found.names[LEFT_CAMERA])
    T_body_left = np.eye(4)
    if needs_extrinsics and left_info is not None:
        T_body_left = motion.extrinsics(left_info.header.frame_id)
    return _images(path, found, stamps, infos, motion, T_body_left)


def read_motion(
    path: Path, *, frames: Frames, topics: Mapping[str, str] | None = None, namespace: str = ""
) -> GivenMotion:
    """Read the motion of a bag that need hold nothing else; errors as :func:`read`."""
    with BagMessages(path) as bag:
        found = find_topics(path, _msgtypes(bag), topics, namespace, images=False)
        motion = RecordedMotion(path, found.names, frames)
        cameras = {found.names.get(side) for side in (LEFT_CAMERA, RIGHT_CAMERA)}
        for connection, _, data in bag.messages(set(found.names.values()) - cameras):
            motion.add(bag, connection, data)
    told = motion.motion()
    if told is None:
        raise VislamError(f"{path}: has no usable twist and no angular velocity of an IMU")
    return GivenMotion(
        str(path), told, ground_truth=motion.ground_truth(), notes=(*found.notes, *motion.notes)
    )


def _images(
    path: Path,
    found: ImageTopics,
    stamps: Mapping[str, set[int]],
    infos: Mapping[str, Any],
    motion: RecordedMotion,
    T_body_left: NDArray[np.float64],
) -> StereoImages:
    left, right = (np.array(sorted(stamps[found.names[side]]), dtype=np.int64) for side in _SIDES)
    pairs = pair_stamps(left, right, half_a_period(left))
    if not len(pairs.first):
        raise VislamError(
            f"{path}: has {len(left)} images on {found.names[LEFT_IMAGE]} and {len(right)} on "
            f"{found.names[RIGHT_IMAGE]}, and none of the same time"
        )
    for topic in (LEFT_CAMERA, RIGHT_CAMERA):
        if found.names[topic] not in infos:
            raise VislamError(f"{path}: no usable message on {found.names[topic]}: it is empty")
    left_info, right_info = (infos[found.names[side]] for side in (LEFT_CAMERA, RIGHT_CAMERA))
    try:
        rig = stereo_rig(left_info, right_info, T_body_left, rectified=found.rectified)
    except RefusedMessage as error:
        names = " and ".join(found.names[side] for side in (LEFT_CAMERA, RIGHT_CAMERA))
        raise VislamError(f"{path}: no usable message on {names}: {error}") from error
    reader = _BagReader(path, found.names, left[pairs.first], right[pairs.second])
    truth = motion.ground_truth()
    if truth is not None:
        truth = from_first_pose(truth.stamps, truth.T_world_body, left[pairs.first])
    return StereoImages(
        name=path.resolve().stem,
        rig=reader.sized(rig),
        stamps=left[pairs.first],
        places=range(len(pairs.first)),
        reader=reader,
        motion=motion.motion(),
        turns=motion.turns() if found.are_of_graph else None,
        is_of_graph=found.are_of_graph,
        ground_truth=truth,
        notes=(*found.notes, *motion.notes, *pairing_notes(left, right, pairs)),
    )


class _BagReader:
    """Reads pairs of a bag in the order of their stamps, holding what waits for its partner."""

    def __init__(self, path: Path, names: Mapping[Topic, str], left: Stamps, right: Stamps):
        self._path = path
        self._topics = [names[side] for side in _SIDES]
        self._stamps = (left, right)

    def sized(self, rig: StereoRig) -> StereoRig:
        """Rig with the size of the images; a VislamError where the camera infos tell another."""
        first = next(self([0]))
        sides: list[RawCamera] = []
        for topic, camera, found in zip(self._topics, (rig.left, rig.right), first, strict=True):
            height, width = found.pixels.shape[:2]
            if all(camera.image_size) and camera.image_size != (width, height):
                raise VislamError(
                    f"{self._path}: images on {topic} have {width} x {height} pixels, and their "
                    f"camera_info {camera.image_size[0]} x {camera.image_size[1]}: calibrate the "
                    "camera for these images"
                )
            sides.append(replace(camera, image_size=(width, height)))
        return replace(rig, left=sides[0], right=sides[1])

    def __call__(self, places: Sequence[int]) -> Iterator[tuple[RawImage, RawImage]]:
        chosen = list(places)
        rows = [
            {int(stamps[place]): row for row, place in enumerate(chosen)}
            for stamps in self._stamps
        ]
        waiting: dict[tuple[int, int], RawImage] = {}
        held = done = 0
        with BagMessages(self._path) as bag:
            for connection, _, data in bag.messages(set(self._topics)):
                side = self._topics.index(connection.topic)
                stamp = _header_stamp(self._path, connection.topic, data)
                row = rows[side].pop(stamp, None)
                if row is None:
                    continue
                waiting[row, side] = self._decoded(bag, connection, data, stamp)
                held += waiting[row, side].pixels.nbytes
                while (done, 0) in waiting and (done, 1) in waiting:
                    pair = waiting.pop((done, 0)), waiting.pop((done, 1))
                    held -= pair[0].pixels.nbytes + pair[1].pixels.nbytes
                    done += 1
                    yield pair
                if done == len(chosen):
                    return
                if held > _MOST_WAITING:
                    raise VislamError(
                        f"{self._path}: images of the same time lie more than "
                        f"{_MOST_WAITING >> 20} MB apart: record both cameras together"
                    )

    def _decoded(self, bag: BagMessages, connection: Any, data: bytes, stamp: int) -> RawImage:
        where = f"{self._path}: {connection.topic} at {stamp} ns"
        message = _decoded_message(self._path, bag, connection, data)
        if connection.msgtype == COMPRESSED_IMAGE:
            return decoded(bytes(message.data), where)
        try:
            return RawImage(*image(message))
        except RefusedMessage as error:
            raise VislamError(f"{where}: {error}") from error


def _msgtypes(bag: BagMessages) -> dict[str, str]:
    return {connection.topic: connection.msgtype for connection in bag.connections}


def _decoded_message(path: Path, bag: BagMessages, connection: Any, data: bytes) -> Any:
    try:
        return bag.decode(connection, data)
    except RefusedMessage as error:
        raise VislamError(f"{path}: topic {connection.topic}: {error}") from error


def _header_stamp(path: Path, topic: str, data: bytes) -> int:
    """Stamp of a message whose header comes first, without decoding the rest."""
    order = "little" if len(data) > 1 and data[1] & 1 else "big"
    sec = int.from_bytes(data[4:8], order, signed=True)  # type: ignore[arg-type]
    nanosec = int.from_bytes(data[8:12], order)  # type: ignore[arg-type]
    if len(data) < 12 or sec < 0 or nanosec >= NANOSECONDS:
        raise VislamError(f"{path}: topic {topic}: an image has no stamp of sec and nanosec")
    return sec * NANOSECONDS + nanosec
