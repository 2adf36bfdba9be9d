# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags written anew with some of their messages changed, and drives compared bit for bit."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.layout import (
    FEATURES,
    GROUND_TRUTH,
    IMU,
    LATCHED_QOS,
    STREAM_QOS,
    TWIST,
    Topic,
)
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory

STORE = get_typestore(Stores.ROS2_JAZZY)
JUNK = b"\x00\x01\x00\x00junk"
"""Bytes that are no message."""

Change = Callable[[str, int, Any], Any]
"""From topic, place in the topic and message to what stands for it: None leaves it out, bytes
stand as they are, a list stands for several."""


def assert_same(one: Any, other: Any) -> None:
    """Equal type for type and bit for bit."""
    assert type(one) is type(other)
    if isinstance(one, Drive | Trajectory):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert one.tobytes() == other.tobytes()
    elif isinstance(one, tuple):
        for own, others in zip(one, other, strict=True):
            assert_same(own, others)
    else:
        assert one == other


def the_drive(bag: Path, **how: Any) -> Drive:
    """The one drive of a bag."""
    (drive,) = read_passes(bag, **how)
    return drive


def as_foreign(drive: Drive, **changes: Any) -> Drive:
    """What a bag that was written anew beside the drive's own gives back."""
    return replace(drive, **{"name": "foreign", "notes": (), **changes})


def rewritten(
    bag: Path,
    change: Change,
    rename: Callable[[str], str | None] = lambda topic: topic,
    msgtype: Callable[[str, str], str] = lambda _, msgtype: msgtype,
    storage: StoragePlugin = StoragePlugin.MCAP,
    log_time: Callable[[str, int, int], int] = lambda _topic, _index, time: time,
    called: str = "foreign",
    *,
    latches: bool = True,
) -> Path:
    """Another bag beside a bag, with each message changed, and nothing latched if so told."""
    output = bag.parent / called
    with BagMessages(bag) as source, Writer(output, version=9, storage_plugin=storage) as writer:
        connections, counts = {}, dict.fromkeys((c.topic for c in source.connections), 0)
        for item in source.connections:
            if name := rename(item.topic):
                connections[item.topic] = writer.add_connection(
                    name,
                    msgtype(item.topic, item.msgtype),
                    typestore=STORE,
                    offered_qos_profiles=[LATCHED_QOS if item.latched and latches else STREAM_QOS],
                )
        for item, time, raw in source.messages():
            if item.topic in connections:
                index = counts[item.topic]
                counts[item.topic] += 1
                told = change(item.topic, index, STORE.deserialize_cdr(raw, item.msgtype))
                for message in told if isinstance(told, list) else [told]:
                    if message is not None:
                        if not isinstance(message, bytes):
                            message = bytes(STORE.serialize_cdr(message, item.msgtype))
                        writer.write(
                            connections[item.topic], log_time(item.topic, index, time), message
                        )
    return output


def unchanged(_topic: str, _index: int, message: Any) -> Any:
    return message


def changing(topic: Topic, change: Callable[[int, Any], Any]) -> Change:
    """A change of one topic's messages only; what it returns is what stands."""
    return lambda name, index, message: (
        change(index, message) if name == topic.recorded else message
    )


def edit(topic: Topic, index: int, action: Callable[[Any], object]) -> Change:
    """A change in place of one message."""

    def change(place: int, message: Any) -> Any:
        if place == index:
            action(message)
        return message

    return changing(topic, change)


def from_half_on_anew(bag: Path) -> Change:
    """A change that lets the stamps of all streams begin anew in the middle of a bag."""
    with BagMessages(bag) as source:
        begin, middle = source.start, source.start + source.duration // 2
    streams = {topic.recorded for topic in (IMU, TWIST, FEATURES, GROUND_TRUTH)}

    def change(topic: str, _index: int, message: Any) -> Any:
        if topic in streams:
            stamp = message.header.stamp
            time = stamp.sec * NANOSECONDS + stamp.nanosec
            if time >= middle:
                stamp.sec, stamp.nanosec = divmod(time - middle + begin, NANOSECONDS)
        return message

    return change
