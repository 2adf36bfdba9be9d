# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing a drive as a rosbag2 directory: MCAP, metadata, provenance and checksums."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from vislam_ros import __version__
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.encoding import encode_drive
from vislam_ros.data.bags.integrity import file_sha256, write_checksums
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    FEATURES,
    GROUND_TRUTH,
    IMU,
    PROVENANCE,
    TOPICS,
    TWIST,
    Frames,
    Topic,
)
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.whole_directory import check_output, whole_directory

_REPORT_EVERY = 200


def check_bag_output(output: Path, *, force: bool) -> None:
    """Refuse an output that exists, unless it is a bag and to be replaced.

    Raises
    ------
    VislamError
    """
    check_output(output, force=force, replaceable=_is_bag_remains)


def write_bag(
    drive: Drive,
    output: Path,
    *,
    source: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    force: bool = False,
    frames: Frames = DEFAULT_FRAMES,
    progress: Progress | None = None,
) -> None:
    """Write a drive as a bag directory that ``ros2 bag`` understands.

    Equal drives and arguments give equal bytes. The directory appears when it is complete.

    Parameters
    ----------
    drive : Drive
    output : Path
        The directory to make.
    source : Path, optional
        The file that the drive was read from; its name and SHA-256 go into ``provenance.json``.
    settings : mapping, optional
        How the drive was read, for ``provenance.json``.
    force : bool
        Replace a bag that exists.
    frames : Frames
    progress : callable, optional
        Called with the share of the messages written.

    Raises
    ------
    VislamError
        Where the output exists or cannot be written, or the drive does not fit into messages.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    contents = Contents(
        name=drive.name,
        notes=drive.notes,
        counts={
            "steps": drive.steps,
            "tracks": drive.tracks,
            "observations": len(drive.ids),
            "twists": len(drive.twist_stamps),
        },
        topics=_message_counts(drive),
        messages=encode_drive(drive, frames, store),
    )
    write_contents(
        contents, store, output, source=source, settings=settings, force=force, progress=progress
    )


@dataclass(frozen=True)
class Contents:
    """What is to stand in a bag.

    Attributes
    ----------
    name : str
        Of the drive.
    notes : tuple of str
        What was repaired or left out.
    counts : mapping of str to int
        How much of what the drive has, for ``provenance.json``.
    topics : mapping of Topic to int
        How many messages there are on each.
    messages : iterator of (Topic, int, bytes)
        Topic, stamp (ns) and CDR bytes of each.
    """

    name: str
    notes: tuple[str, ...]
    counts: Mapping[str, int]
    topics: Mapping[Topic, int]
    messages: Iterator[tuple[Topic, int, memoryview]]


def write_contents(
    contents: Contents,
    store: Typestore,
    output: Path,
    *,
    source: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write messages as a bag, as :func:`write_bag` does; ``store`` knows their types."""
    provenance = _provenance(contents, source, settings or {})
    with whole_directory(output, force=force, replaceable=_is_bag_remains) as work:
        _write_messages(contents, store, work, provenance, progress)
        write_checksums(work)


def _provenance(
    contents: Contents, source: Path | None, settings: Mapping[str, Any]
) -> dict[str, Any]:
    origin = None
    if source is not None:
        sha256 = file_sha256(source) if source.is_file() else None
        origin = {"name": source.name, "sha256": sha256}
    return {
        "name": contents.name,
        "source": origin,
        "vislam_ros": __version__,
        "settings": dict(settings),
        "notes": list(contents.notes),
        "counts": dict(contents.counts),
        "messages": {topic.recorded: count for topic, count in contents.topics.items()},
    }


def _message_counts(drive: Drive) -> dict[Topic, int]:
    """How many messages a drive makes on each topic that it needs, in the order of TOPICS."""
    streams = {IMU: len(drive.twist_stamps), FEATURES: drive.steps}
    if drive.measures_velocity:
        streams[TWIST] = len(drive.twist_stamps)
    if drive.ground_truth is not None:
        streams[GROUND_TRUTH] = len(drive.ground_truth)
    return {
        topic: 1 if topic.latched else streams[topic]
        for topic in TOPICS
        if topic.latched or topic in streams
    }


def _write_messages(
    contents: Contents,
    store: Typestore,
    work: Path,
    provenance: Mapping[str, Any],
    progress: Progress | None,
) -> None:
    writer = Writer(work, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    total = sum(contents.topics.values())
    with writer:
        # First, so that a directory without checksums shows that it was cut off, not recorded.
        text = json.dumps(provenance, indent=2, ensure_ascii=False)
        (work / PROVENANCE).write_text(f"{text}\n", encoding="utf-8")
        connections = {
            topic: writer.add_connection(
                topic.recorded, topic.msgtype, typestore=store, offered_qos_profiles=[topic.qos]
            )
            for topic in contents.topics
        }
        for done, (topic, stamp, data) in enumerate(contents.messages, start=1):
            writer.write(connections[topic], stamp, data)
            if progress and (done % _REPORT_EVERY == 0 or done == total):
                progress(done / total)


def _is_bag_remains(path: Path) -> bool:
    """Whether a path is a bag, or what is left of one, which may be replaced."""
    return is_bag(path) or (path / PROVENANCE).is_file()
