# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag hold images, their cameras and the motion: by name, or by type.

A topic that is not there under its name, and for which ``--remap`` names none, is looked for among
those of its type, as drivers call them: ``left`` beside ``right``, ``infra1`` beside ``infra2``,
``camera_info`` beside its images, ``gyro`` of an IMU in parts.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vislam_ros.data.bags.layout import (
    COMPRESSED_IMAGE,
    EXTRINSICS,
    FEATURES,
    GROUND_TRUTH,
    IMU,
    LEFT_CAMERA,
    LEFT_COMPRESSED,
    LEFT_IMAGE,
    RIGHT_CAMERA,
    RIGHT_COMPRESSED,
    RIGHT_IMAGE,
    STATIC_TRANSFORMS,
    TWIST,
    Topic,
)
from vislam_ros.data.bags.naming import hint, names_in_bag, namespace_of
from vislam_ros.errors import VislamError

_TOPICS = (
    LEFT_IMAGE,
    RIGHT_IMAGE,
    LEFT_CAMERA,
    RIGHT_CAMERA,
    EXTRINSICS,
    STATIC_TRANSFORMS,
    IMU,
    TWIST,
    GROUND_TRUTH,
)
_IMAGES = (LEFT_IMAGE.msgtype, COMPRESSED_IMAGE)
_COMPRESSED = "/compressed"
# Where the names of two cameras differ.
_SIDES = re.compile(r"(left|right|\d+)")


@dataclass(frozen=True)
class ImageTopics:
    """What a bag calls what is read from it.

    Attributes
    ----------
    names : mapping of Topic to str
        Of those that the bag has.
    notes : tuple of str
        What was taken without having been named.
    """

    names: Mapping[Topic, str]
    notes: tuple[str, ...]

    @property
    def are_of_graph(self) -> bool:
        """Whether the nodes hear all they need under the names that they have for it."""
        needed = (LEFT_CAMERA, RIGHT_CAMERA, EXTRINSICS, IMU)
        images = tuple(self.names.get(side) for side in (LEFT_IMAGE, RIGHT_IMAGE))
        usual = [
            tuple(topic.recorded for topic in pair)
            for pair in ((LEFT_IMAGE, RIGHT_IMAGE), (LEFT_COMPRESSED, RIGHT_COMPRESSED))
        ]
        return images in usual and all(self.names.get(topic) == topic.recorded for topic in needed)

    @property
    def rectified(self) -> bool:
        """Whether the images are rectified, as their name says."""
        return "rect" in self.names[LEFT_IMAGE]


def has_images(msgtypes: Mapping[str, str], topics: Mapping[str, str] | None = None) -> bool:
    """Whether a bag, of topics and their types, is one of images: they are meant, or features not.

    Parameters
    ----------
    msgtypes : mapping of str to str
    topics : mapping of str to str, optional
        As :func:`find_topics`.
    """
    images = {name for name, msgtype in msgtypes.items() if msgtype in _IMAGES}
    renamed = {ours.strip("/") for ours in topics or ()}
    if not images or FEATURES.name in renamed:
        return False
    meant = any(LEFT_IMAGE.name in ours or RIGHT_IMAGE.name in ours for ours in renamed)
    return meant or not has_features(msgtypes)


def has_features(msgtypes: Mapping[str, str]) -> bool:
    """Whether a bag, of topics and their types, has features under their name."""
    return any(name.endswith(FEATURES.recorded) for name in msgtypes)


def find_topics(
    path: Path,
    msgtypes: Mapping[str, str],
    topics: Mapping[str, str] | None,
    namespace: str,
    *,
    images: bool = True,
) -> ImageTopics:
    """Find the topics of a bag.

    Parameters
    ----------
    path : Path
        For errors.
    msgtypes : mapping of str to str
        Type of each topic that the bag has.
    topics : mapping of str to str or None
        The bag's name for a topic by ours.
    namespace : str
    images : bool
        Whether they are needed, or the motion alone.

    Raises
    ------
    VislamError
        Where one is missing, or none stands out.
    """
    namespace = namespace_of(namespace)
    given = names_in_bag(_TOPICS, list(msgtypes), namespace, topics)
    usual = names_in_bag(_TOPICS, list(msgtypes), namespace)
    search = _Search(path, msgtypes, given, {t for t in _TOPICS if given[t] != usual[t]})
    if images:
        search.find_images()
        for camera, image in ((LEFT_CAMERA, LEFT_IMAGE), (RIGHT_CAMERA, RIGHT_IMAGE)):
            search.find_camera(camera, image)
    search.find_motion()
    for topic in (EXTRINSICS, STATIC_TRANSFORMS, GROUND_TRUTH, LEFT_CAMERA, RIGHT_CAMERA):
        search.take_if_there(topic)
    return ImageTopics(search.found, tuple(search.notes))


class _Search:
    def __init__(
        self,
        path: Path,
        msgtypes: Mapping[str, str],
        names: Mapping[Topic, str],
        renamed: set[Topic],
    ):
        self._path, self._msgtypes, self._names, self._renamed = path, msgtypes, names, renamed
        self.found: dict[Topic, str] = {}
        self.notes: list[str] = []

    def take_if_there(self, topic: Topic) -> bool:
        """Take a topic under the name that it should have; whether it is there."""
        name = self._names[topic]
        if topic in self.found:
            return True
        if name not in self._msgtypes:
            if topic in self._renamed:
                raise self._missing(topic)
            return False
        if self._msgtypes[name] != topic.msgtype:
            raise VislamError(
                f"{self._path}: topic {name} has type {self._msgtypes[name]}: {topic.msgtype} is "
                "needed"
            )
        self.found[topic] = name
        return True

    def find_images(self) -> None:
        for topic in (LEFT_IMAGE, RIGHT_IMAGE):
            name = self._names[topic]
            usual = (name, name + _COMPRESSED) if topic not in self._renamed else (name,)
            there = next((each for each in usual if each in self._msgtypes), None)
            if there is not None:
                if self._msgtypes[there] not in _IMAGES:
                    raise VislamError(
                        f"{self._path}: topic {there} has type {self._msgtypes[there]}: "
                        f"{' or '.join(_IMAGES)} is needed"
                    )
                self.found[topic] = there
            elif topic in self._renamed:
                raise self._missing(topic)
        if LEFT_IMAGE in self.found and RIGHT_IMAGE in self.found:
            return
        if self.found:
            raise self._missing(RIGHT_IMAGE if LEFT_IMAGE in self.found else LEFT_IMAGE)
        left, right = self._likely_pair()
        self.found |= {LEFT_IMAGE: left, RIGHT_IMAGE: right}
        self.notes.append(f"Took {left} and {right} for the images.")

    def find_camera(self, topic: Topic, image: Topic) -> None:
        if self.take_if_there(topic):
            return
        name = self.found[image].removesuffix(_COMPRESSED)
        beside = f"{name.rpartition('/')[0]}/camera_info"
        if self._msgtypes.get(beside) != topic.msgtype:
            raise self._missing(topic)
        self.found[topic] = beside

    def find_motion(self) -> None:
        """Find twists and an IMU; one of other names only where there are no twists."""
        has_twists, has_imu = self.take_if_there(TWIST), self.take_if_there(IMU)
        if has_twists or has_imu:
            return
        others = [name for name, msgtype in self._msgtypes.items() if msgtype == IMU.msgtype]
        gyros = [name for name in others if "gyro" in name]
        turning = gyros if len(gyros) == 1 else [n for n in others if "accel" not in n]
        if len(turning) == 1:
            self.found[IMU] = turning[0]
            self.notes.append(f"Took {turning[0]} for the IMU.")
        elif turning:
            raise VislamError(
                f"{self._path}: has {len(turning)} IMUs: name one of {', '.join(sorted(turning))} "
                f"with --remap {IMU.name}:=NAME"
            )

    def _likely_pair(self) -> tuple[str, str]:
        names = sorted(
            name
            for name, msgtype in self._msgtypes.items()
            if msgtype in _IMAGES and "depth" not in name.lower()
        )
        pairs = [(left, right) for left in names for right in names if _is_pair(left, right)]
        with_cameras = [pair for pair in pairs if all(map(self._has_camera, pair))]
        pairs = with_cameras or pairs
        # Of one camera's images those that lost nothing, and are rectified, count.
        for mark, wanted in ((_COMPRESSED, False), ("rect", True)):
            better = [pair for pair in pairs if (mark in pair[0]) is wanted]
            pairs = better or pairs
        if len(pairs) != 1:
            what = "no two are a pair" if not pairs else "more than two could be the pair"
            raise VislamError(
                f"{self._path}: has the images {', '.join(names) or 'none'}, and {what}: name "
                f"them with --remap {LEFT_IMAGE.name}:=NAME {RIGHT_IMAGE.name}:=NAME"
            )
        return pairs[0]

    def _has_camera(self, name: str) -> bool:
        beside = f"{name.removesuffix(_COMPRESSED).rpartition('/')[0]}/camera_info"
        return self._msgtypes.get(beside) == LEFT_CAMERA.msgtype

    def _missing(self, topic: Topic) -> VislamError:
        names: Sequence[str] = [
            name
            for name, msgtype in self._msgtypes.items()
            if msgtype == topic.msgtype or (topic.msgtype in _IMAGES and msgtype in _IMAGES)
        ]
        return VislamError(
            f"{self._path}: has no topic {self._names[topic]} ({topic.msgtype}): "
            f"{hint(topic, names)}"
        )


def _is_pair(left: str, right: str) -> bool:
    """Whether two names differ in one place, as those of a left and of a right camera do."""
    ours, theirs = _SIDES.split(left.lower()), _SIDES.split(right.lower())
    if len(ours) != len(theirs):
        return False
    others = [(a, b) for a, b in zip(ours, theirs, strict=True) if a != b]
    if len(others) != 1:
        return False
    ((a, b),) = others
    return (a, b) == ("left", "right") or (
        a.isdigit() and b.isdigit() and len(a) < 10 and len(b) < 10 and int(b) == int(a) + 1
    )
