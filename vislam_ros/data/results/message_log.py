# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``results.mcap``: messages as they came, readable up to the last second after a kill."""

import functools
import time
from pathlib import Path

import yaml
from mcap.writer import Writer
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags.layout import Topic
from vislam_ros.data.files.open_file import require_present
from vislam_ros.errors import OutputError

_FLUSH_PERIOD = 1.0  # seconds


class MessageLog:
    """Writes serialised messages and their definitions.

    Parameters
    ----------
    path : Path
        Is replaced where it exists.

    Raises
    ------
    OutputError
        From any method, where the file cannot be written or is no longer there.
    """

    def __init__(self, path: Path):
        self._path = path
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._flushed = time.monotonic()
        try:
            self._file = path.open("wb")
            self._writer = Writer(self._file)
            self._writer.start(profile="ros2")
        except OSError as error:
            raise self._error(error) from error

    def write(self, topic: Topic, data: bytes, stamp: int) -> None:
        """Add a message: its CDR bytes and a time in nanoseconds."""
        try:
            self._writer.add_message(self._channel(topic), stamp, data, publish_time=stamp)
        except OSError as error:
            raise self._error(error) from error

    def refresh(self) -> None:
        """Flush if the last flush is a second old."""
        if time.monotonic() - self._flushed >= _FLUSH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the system, as a chunk that can be read back."""
        try:
            self._writer.flush()
            require_present(self._path, self._file)
        except OSError as error:
            raise self._error(error) from error
        self._flushed = time.monotonic()

    def close(self) -> None:
        """Write the index and close the file."""
        try:
            with self._file:
                self._writer.finish()
        except OSError as error:
            raise self._error(error) from error

    def _channel(self, topic: Topic) -> int:
        if topic.name not in self._channels:
            if topic.msgtype not in self._schemas:
                self._schemas[topic.msgtype] = self._writer.register_schema(
                    topic.msgtype, "ros2msg", _definition(topic.msgtype)
                )
            qos = yaml.safe_dump(dump_qos_v9([topic.qos]), sort_keys=False)
            self._channels[topic.name] = self._writer.register_channel(
                topic.recorded,
                "cdr",
                self._schemas[topic.msgtype],
                {"offered_qos_profiles": qos},
            )
        return self._channels[topic.name]

    def _error(self, error: OSError) -> OutputError:
        return OutputError(f"{self._path}: cannot write this file: {error.strerror}")


@functools.cache
def _definition(msgtype: str) -> bytes:
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(msgtype, ros_version=2)
    return text.encode("utf-8")
