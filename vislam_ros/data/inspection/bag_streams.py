# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The streams of a bag, by the stamps in the headers of their messages, in the order recorded."""

import struct
from pathlib import Path

import numpy as np

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.inspection.streams import Stream

# Types whose bytes begin with a header.
_WITH_HEADER = (
    "sensor_msgs/msg/",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistWithCovarianceStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/PoseStamped",
)
_NOT_JUDGED = ("CameraInfo",)
_SECOND = 1_000_000_000


def streams_of_bag(path: Path, topics: "frozenset[str] | None" = None) -> tuple[Stream, ...]:
    """Read the stamps of a bag's streams, a stream for each topic with headers.

    Parameters
    ----------
    path : Path
    topics : frozenset of str, optional
        Only these.

    Raises
    ------
    VislamError
        Where the bag cannot be read.
    """
    stamps: dict[str, list[int]] = {}
    with BagMessages(path) as bag:
        chosen = [
            each.topic
            for each in bag.connections
            if each.msgtype.startswith(_WITH_HEADER)
            and not each.msgtype.endswith(_NOT_JUDGED)
            and (topics is None or each.topic in topics)
        ]
        for connection, _, data in bag.messages(chosen):
            stamp = _stamp(data)
            if stamp is not None:
                stamps.setdefault(connection.topic, []).append(stamp)
    return tuple(
        Stream.of(topic, np.array(of_topic, dtype=np.int64))
        for topic, of_topic in sorted(stamps.items())
    )


def _stamp(data: bytes) -> int | None:
    """Stamp in nanoseconds of a message whose CDR bytes begin with a header."""
    if len(data) < 12:
        return None
    order = "<" if data[1] & 1 else ">"
    second, nanosecond = struct.unpack_from(f"{order}iI", data, 4)
    return int(second) * _SECOND + int(nanosecond)
