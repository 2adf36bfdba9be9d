# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Writing a drive as a rosbag2 directory: MCAP, metadata, provenance and checksums."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

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
    provenance = _provenance(drive, source, settings or {})
    with whole_directory(output, force=force, replaceable=_is_bag_remains) as work:
        _write_messages(drive, work, provenance, frames, progress)
        write_checksums(work)


def _provenance(drive: Drive, source: Path | None, settings: Mapping[str, Any]) -> dict[str, Any]:
    origin = None
    if source is not None:
        sha256 = file_sha256(source) if source.is_file() else None
        origin = {"name": source.name, "sha256": sha256}
    return {
        "name": drive.name,
        "source": origin,
        "vislam_ros": __version__,
        "settings": dict(settings),
        "notes": list(drive.notes),
        "counts": {
            "steps": drive.steps,
            "tracks": drive.tracks,
            "observations": len(drive.ids),
            "twists": len(drive.twist_stamps),
        },
        "messages": {topic.recorded: count for topic, count in _message_counts(drive).items()},
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
    drive: Drive,
    work: Path,
    provenance: Mapping[str, Any],
    frames: Frames,
    progress: Progress | None,
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(work, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    counts = _message_counts(drive)
    total = sum(counts.values())
    with writer:
        # First, so that a directory without checksums shows that it was cut off, not recorded.
        text = json.dumps(provenance, indent=2, ensure_ascii=False)
        (work / PROVENANCE).write_text(f"{text}\n", encoding="utf-8")
        connections = {
            topic: writer.add_connection(
                topic.recorded, topic.msgtype, typestore=store, offered_qos_profiles=[topic.qos]
            )
            for topic in counts
        }
        for done, (topic, stamp, data) in enumerate(encode_drive(drive, frames, store), start=1):
            writer.write(connections[topic], stamp, data)
            if progress and (done % _REPORT_EVERY == 0 or done == total):
                progress(done / total)


def _is_bag_remains(path: Path) -> bool:
    """Whether a path is a bag, or what is left of one, which may be replaced."""
    return is_bag(path) or (path / PROVENANCE).is_file()
