# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading bags: raw messages for the player, and a whole :class:`Drive`."""

import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import ConnectionExtRosbag2, Qos, QosDurability
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    FEATURES,
    GROUND_TRUTH,
    LEFT_CAMERA,
    PROVENANCE,
    RIGHT_CAMERA,
    TOPICS,
    TWIST,
    Topic,
)
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a directory with metadata.yaml, or a storage file."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.is_file() and path.suffix in (".mcap", ".db3")


@dataclass(frozen=True)
class BagConnection:
    """A topic of a bag.

    Attributes
    ----------
    topic, msgtype : str
        Such as ``/imu/data`` and ``sensor_msgs/msg/Imu``.
    count : int
        Number of messages.
    qos : rosbags.interfaces.Qos or None
        The first profile that was offered, where the bag knows one.
    """

    topic: str
    msgtype: str
    count: int
    qos: Qos | None

    @property
    def latched(self) -> bool:
        """Whether late subscribers are to get the last message (transient local)."""
        return self.qos is not None and self.qos.durability is QosDurability.TRANSIENT_LOCAL


class BagMessages:
    """The messages of a bag, undecoded: a context manager.

    Damage is not looked for here; see :func:`vislam_ros.data.bags.integrity.require_intact`.

    Parameters
    ----------
    path : Path
        A bag directory or a bare ``.mcap`` or ``.db3`` file.

    Attributes
    ----------
    connections : tuple of BagConnection
    start, end : int
        Log times of the first and of the last message, nanoseconds; both 0 where there is none.

    Raises
    ------
    VislamError
        On opening or reading what is missing, cut off or otherwise no bag.
    """

    def __init__(self, path: Path):
        self.path = path
        self.connections: tuple[BagConnection, ...] = ()
        self.start = 0
        self.end = 0

    def __enter__(self) -> "BagMessages":
        if not self.path.exists():
            raise VislamError(f"{self.path}: no such file or directory")
        if not is_bag(self.path):
            raise VislamError(
                f"{self.path}: is not a bag: that is a directory with metadata.yaml, or .mcap"
            )
        try:
            self._reader = AnyReader(
                [self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
            )
            self._reader.open()
        except Exception as error:  # damaged bags raise errors of every kind
            raise self._unreadable(error) from error
        self._by_connection = {
            connection.id: BagConnection(
                connection.topic,
                connection.msgtype,
                connection.msgcount,
                _first_qos(connection.ext),
            )
            for connection in self._reader.connections
        }
        self.connections = tuple(self._by_connection.values())
        if self._reader.message_count:
            # The reader's end is the first nanosecond after the last message.
            self.start, self.end = self._reader.start_time, self._reader.end_time - 1
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._reader.close()

    @property
    def duration(self) -> int:
        """Nanoseconds from the first message to the last."""
        return self.end - self.start

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(connection.count for connection in self.connections)

    def messages(
        self,
        topics: Collection[str] | None = None,
        *,
        start_offset: int = 0,
        stop_offset: int | None = None,
    ) -> Iterator[tuple[BagConnection, int, bytes]]:
        """Yield connection, log time (ns) and CDR bytes of each message, in time order.

        Parameters
        ----------
        topics : collection of str, optional
            Names as in the bag; all topics where None.
        start_offset : int
            Nanoseconds after the bag's start. Messages of latched topics from before that come
            first, with their own log times: what follows needs them.
        stop_offset : int, optional
            Nanoseconds after the bag's start; later messages are left out, one at that very time
            is not.
        """
        chosen = [
            connection
            for connection in self._reader.connections
            if topics is None or connection.topic in topics
        ]
        latched = [item for item in chosen if self._by_connection[item.id].latched]
        begin = self.start + start_offset
        stop = (self.end if stop_offset is None else self.start + stop_offset) + 1
        if start_offset > 0:
            yield from self._read(latched, self.start, min(begin, stop))
        yield from self._read(chosen, begin, stop)

    def decode(self, connection: BagConnection, data: bytes) -> Any:
        """Message of its CDR bytes.

        Raises
        ------
        ValueError
            Where they are no message of the connection's type.
        """
        try:
            return self._reader.deserialize(data, connection.msgtype)
        except AnyReaderError as error:
            raise ValueError("not a message of its type") from error

    def _read(
        self, connections: list[Any], start: int, stop: int
    ) -> Iterator[tuple[BagConnection, int, bytes]]:
        if not connections or start >= stop:
            return
        try:
            for connection, stamp, data in self._reader.messages(connections, start, stop):
                yield self._by_connection[connection.id], stamp, data
        except Exception as error:  # damaged bags raise errors of every kind
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> VislamError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return VislamError(f"{self.path}: cannot read this bag: {reason}")


def _first_qos(extension: object) -> Qos | None:
    profiles = (
        extension.offered_qos_profiles if isinstance(extension, ConnectionExtRosbag2) else []
    )
    return profiles[0] if profiles else None


@dataclass
class _Stream:
    """What was heard on one topic."""

    topic: Topic
    name: str
    decode: Callable[[Any], Any]
    stamps: list[int] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)

    def hear(self, message: Any) -> None:
        """Keep a message's stamp and value; of a latched topic the first only.

        Raises
        ------
        ValueError
            The message is bad.
        """
        if self.topic.latched and self.values:
            return
        stamp = decoding.stamp(message.header)
        if self.stamps and stamp <= self.stamps[-1]:
            raise ValueError("stamp not later than the one before")
        self.values.append(self.decode(message))
        self.stamps.append(stamp)

    def notes(self) -> list[str]:
        return [
            f"Skipped {count} message{'s' if count > 1 else ''} of {self.name}: {reason}."
            for reason, count in sorted(self.skipped.items())
        ]


_DECODERS: dict[Topic, Callable[[Any], Any]] = {
    LEFT_CAMERA: decoding.projection,
    RIGHT_CAMERA: decoding.projection,
    EXTRINSICS: decoding.transform,
    TWIST: decoding.twist,
    FEATURES: decoding.features,
    GROUND_TRUTH: decoding.pose,
}


def read_drive(path: Path, *, topics: Mapping[str, str] | None = None) -> Drive:
    """Read a drive from a bag.

    Messages that are not finite, malformed, or stamped no later than the one before are left out
    and counted in the drive's notes.

    Parameters
    ----------
    path : Path
        A bag directory or a bare ``.mcap`` file.
    topics : mapping of str to str, optional
        The bag's name for a topic of :mod:`vislam_ros.data.bags.layout`, such as
        ``{"imu/twist": "/car/twist"}``.

    Raises
    ------
    VislamError
        Where the bag cannot be read, lacks a topic, has one of another type, has a features
        cloud without a needed field, or holds no usable message on a needed topic.
    """
    names = _recorded_names(topics or {})
    with BagMessages(path) as bag:
        streams = _streams(bag, names)
        for connection, _, data in bag.messages(streams.keys()):
            stream = streams[connection.topic]
            try:
                stream.hear(bag.decode(connection, data))
            except ValueError as error:
                stream.skipped[str(error)] += 1
            except VislamError as error:
                raise VislamError(f"{path}: topic {connection.topic}: {error}") from error
    heard = {stream.topic: stream for stream in streams.values()}
    for stream in heard.values():
        if not stream.values and stream.topic is not GROUND_TRUTH:
            reasons = ", ".join(sorted(stream.skipped)) or "it is empty"
            raise VislamError(f"{path}: topic {stream.name} has no usable message: {reasons}")
    name, notes = _provenance(path)
    for stream in heard.values():
        notes.extend(stream.notes())
    return _assemble(path, name, notes, heard)


def _recorded_names(remapped: Mapping[str, str]) -> dict[Topic, str]:
    """Each topic's name in the bag."""
    known = {topic.name: topic for topic in TOPICS}
    names = {topic: topic.recorded for topic in _DECODERS}
    for ours, recorded in remapped.items():
        topic = known.get(ours.lstrip("/"))
        if topic not in names:
            raise VislamError(
                f"topic {ours!r} cannot be remapped: choose from "
                + ", ".join(topic.name for topic in names)
            )
        names[topic] = recorded if recorded.startswith("/") else f"/{recorded}"
    return names


def _streams(bag: BagMessages, names: Mapping[Topic, str]) -> dict[str, _Stream]:
    """An empty stream for each topic of a drive that the bag has, by its name in the bag."""
    msgtypes = {connection.topic: connection.msgtype for connection in bag.connections}
    streams = {}
    for topic, name in names.items():
        if name not in msgtypes:
            if topic is GROUND_TRUTH:
                continue
            raise VislamError(
                f"{bag.path}: has no topic {name} ({topic.msgtype}): remap {topic.name} to one "
                f"that it has: {', '.join(sorted(msgtypes)) or 'none'}"
            )
        if msgtypes[name] != topic.msgtype:
            raise VislamError(
                f"{bag.path}: topic {name} has type {msgtypes[name]}: {topic.msgtype} is needed"
            )
        streams[name] = _Stream(topic, name, _DECODERS[topic])
    return streams


def _assemble(path: Path, name: str, notes: list[str], heard: Mapping[Topic, _Stream]) -> Drive:
    left, right = heard[LEFT_CAMERA], heard[RIGHT_CAMERA]
    try:
        camera = decoding.stereo_camera(
            left.values[0], right.values[0], heard[EXTRINSICS].values[0]
        )
    except ValueError as error:
        raise VislamError(f"{path}: topics {left.name} and {right.name}: {error}") from error
    frames = heard[FEATURES].values
    pixels = np.concatenate([pixels for _, pixels in frames])
    size = left.values[0].image_size  # 0 x 0 says that it is not known
    truth = heard.get(GROUND_TRUTH)
    return Drive(
        name=name,
        camera=camera,
        image_size=size if all(size) else image_size_that_holds(pixels),
        twist_stamps=np.array(heard[TWIST].stamps, dtype=np.int64),
        twists=np.array(heard[TWIST].values),
        feature_stamps=np.array(heard[FEATURES].stamps, dtype=np.int64),
        offsets=np.cumsum([0, *(len(ids) for ids, _ in frames)], dtype=np.int64),
        ids=np.concatenate([ids for ids, _ in frames]),
        pixels=pixels,
        ground_truth=_trajectory(truth) if truth and truth.values else None,
        notes=tuple(notes),
    )


def _trajectory(stream: _Stream) -> Trajectory:
    poses = np.array(stream.values)
    return Trajectory(np.array(stream.stamps, dtype=np.int64), poses[:, :3], poses[:, 3:])


def _provenance(path: Path) -> tuple[str, list[str]]:
    """Name of a drive, and notes of what was repaired when its bag was written."""
    file = path / PROVENANCE
    if not file.is_file():
        return (path.name if path.is_dir() else path.stem), []
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return str(content["name"]), [str(note) for note in content["notes"]]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise VislamError(
            f"{file}: cannot read it ({type(error).__name__}: {error}): convert the drive anew, "
            "or remove the file"
        ) from error
