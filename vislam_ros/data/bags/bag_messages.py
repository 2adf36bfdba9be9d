# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag as they are stored: raw for the player, decoded by their type."""

import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, Nodetype, Qos, QosDurability
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.claims import check_bag
from vislam_ros.data.files.inputs import read_text
from vislam_ros.errors import VislamError

# Storages and how their files are called; what metadata.yaml says of it, plain or quoted.
_STORED = {"mcap": ".mcap", "sqlite3": ".db3"}
_STORAGE = re.compile(r"""^ *storage_identifier: *['"]?([^'"\s]*)""", re.MULTILINE)


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a directory with metadata.yaml, or a storage file."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.is_file() and path.suffix in (".mcap", ".db3")


def lacks(path: Path) -> str | None:
    """What a directory with a bag's files has not; None where it has none."""
    if is_bag(path) or not path.is_dir():
        return None
    files = sorted(each.name for each in path.iterdir() if is_bag(each) and each.is_file())
    if not files:
        return None
    return (
        f"{path}: has {files[0]} and no metadata.yaml, as after a crash: give the file itself, or "
        "let ros2 bag reindex write it"
    )


def _readable(path: Path) -> Path:
    """Bag as its reader can open it: the one file of a directory that does not name its storage.

    Raises
    ------
    VislamError
        Where the directory's metadata names a storage that is none.
    """
    if not path.is_dir():
        return path
    metadata = path / "metadata.yaml"
    found = _STORAGE.search(read_text(metadata, "this bag"))
    storage = found[1] if found else "mcap"
    if storage in _STORED:
        return path
    files = sorted(each for each in path.iterdir() if each.suffix in _STORED.values())
    if not storage and len(files) == 1:
        return files[0]
    raise VislamError(
        f"{metadata}: storage_identifier is {storage!r}: write mcap for .mcap files, sqlite3 for "
        ".db3"
    )


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
        check_bag(self.path)
        try:
            self._reader = AnyReader(
                [_readable(self.path)], default_typestore=get_typestore(Stores.ROS2_JAZZY)
            )
            self._reader.open()
            self._take_description()
        except VislamError:
            raise
        except Exception as error:  # damaged bags raise errors of every kind
            raise self._unreadable(error) from error
        return self

    def _take_description(self) -> None:
        """Take what the bag says of itself, which may be anything."""
        self._foreign = _foreign_types(self._reader.typestore)
        self._by_connection = {
            connection.id: BagConnection(
                connection.topic,
                connection.msgtype,
                int(connection.msgcount),
                _first_qos(connection.ext),
            )
            for connection in self._reader.connections
        }
        self.connections = tuple(self._by_connection.values())
        if int(self._reader.message_count):
            # The reader's end is the first nanosecond after the last message.
            self.start, self.end = int(self._reader.start_time), int(self._reader.end_time) - 1

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
        RefusedMessage
            Where they are no message of the connection's type, or the bag has another definition
            of it than ROS.
        """
        if connection.msgtype in self._foreign:
            raise RefusedMessage(Refusal.UNDECODABLE)
        try:
            return self._reader.deserialize(data, connection.msgtype)
        except Exception as error:  # damaged bytes and types raise errors of every kind
            raise RefusedMessage(Refusal.UNDECODABLE) from error

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
        if isinstance(error, KeyError):  # all that it says is the key
            reason = f"its metadata lacks {reason}, of a topic or of its QoS"
        return VislamError(f"{self.path}: cannot read this bag: {reason}")


def _first_qos(extension: object) -> Qos | None:
    profiles = (
        extension.offered_qos_profiles if isinstance(extension, ConnectionExtRosbag2) else []
    )
    return profiles[0] if profiles else None


def _foreign_types(store: Typestore) -> set[str]:
    """Types that a bag defines with other fields than ROS does, and those made of them."""
    ours, theirs = get_typestore(Stores.ROS2_JAZZY).fielddefs, store.fielddefs
    known = [name for name in theirs if name in ours]
    foreign = {name for name in known if theirs[name][1] != ours[name][1]}
    made = foreign
    while made:
        made = {n for n in known if n not in foreign and made & set(_parts(theirs[n][1]))}
        foreign = foreign | made
    return foreign


def _parts(fields: Iterable[tuple[str, Any]]) -> Iterator[str]:
    """Names of the types that fields are made of."""
    for _, (kind, detail) in fields:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, detail = detail[0]
        if kind == Nodetype.NAME:
            yield detail
