# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The bag that a run plays: what it calls its topics, and what nodes and player are told of it."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vislam_ros.data.bags.bag_messages import BagMessages, is_bag
from vislam_ros.data.bags.layout import (
    FEATURES,
    IMAGES,
    IMU,
    LEFT_COMPRESSED,
    LEFT_IMAGE,
    TOPICS,
    TWIST,
    Topic,
)
from vislam_ros.data.bags.naming import names_in_bag, namespace_of
from vislam_ros.errors import VislamError

_KNOWN = (*TOPICS, *IMAGES)


def renamed_topics(arguments: argparse.Namespace) -> dict[str, str]:
    """The bag's name for a topic by ours, as ``--remap`` tells.

    Raises
    ------
    VislamError
        Where there is no bag whose topics could have names.
    """
    bags = [path for path in (arguments.data, arguments.motion) if path and is_bag(path)]
    if arguments.remap and arguments.data.exists() and not bags:
        raise VislamError(f"{arguments.data}: is no bag: leave out --remap, which is for topics")
    pairs = (rule.partition(":=") for rule in arguments.remap)
    return {ours: recorded for ours, _, recorded in pairs}


@dataclass(frozen=True)
class PlayedBag:
    """A bag for the nodes of one namespace.

    Attributes
    ----------
    path : Path
    namespace : str
        Of nodes and player; empty is the outermost one.
    names : mapping of Topic to str
        What the bag calls the topics of a drive, and its images.
    counts : mapping of str to int
        Messages of each topic that the bag has.
    """

    path: Path
    namespace: str
    names: Mapping[Topic, str]
    counts: Mapping[str, int]

    @classmethod
    def of(cls, path: Path, namespace: str, renamed: Mapping[str, str]) -> "PlayedBag":
        """Look into a bag; raises a VislamError where it cannot be opened."""
        with BagMessages(path) as bag:
            counts = {connection.topic: connection.count for connection in bag.connections}
        namespace = namespace_of(namespace)
        return cls(path, namespace, names_in_bag(_KNOWN, counts, namespace, renamed), counts)

    @property
    def has_gyroscope_alone(self) -> bool:
        """Whether the bag has no topic of twists, and one of an IMU."""
        return self.names[TWIST] not in self.counts and self.names[IMU] in self.counts

    @property
    def images(self) -> Topic | None:
        """Topic of the left images that are to be tracked; None where there are features."""
        if self.counts.get(self.names[FEATURES]):
            return None
        sides = (LEFT_IMAGE, LEFT_COMPRESSED)
        return next((side for side in sides if self.counts.get(self.names[side])), None)

    @property
    def frames(self) -> int:
        """Number of features messages, or of left images where there are none."""
        return self.counts.get(self.names[self.images or FEATURES], 0)

    @property
    def node_arguments(self) -> list[str]:
        """What ROS is told of the nodes' names."""
        return ["-r", f"__ns:={self.namespace}"] if self.namespace else []

    @property
    def player_arguments(self) -> list[str]:
        """Flags of ``vislam play`` that make it speak to these nodes."""
        flags = [f"--namespace={self.namespace}"] if self.namespace else []
        usual = names_in_bag(_KNOWN, self.counts, self.namespace)
        others = {topic: name for topic, name in self.names.items() if name != usual[topic]}
        rules = [f"{name}:={self.namespace}{topic.recorded}" for topic, name in others.items()]
        if not rules:
            return flags
        # What would be heard beside what stands in for it.
        shadowed = {usual[topic] for topic in others} - set(self.names.values())
        played = sorted(self.counts.keys() - shadowed)
        return [*flags, "--topics", *played, "--remap", *rules]
