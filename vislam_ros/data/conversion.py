# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a dataset or images, and a reference where there is one, to a bag."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import file_sha256, require_intact
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, Frames
from vislam_ros.data.bags.reader import ReadingRules
from vislam_ros.data.bags.writer import check_bag_output, write_bag
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import read_dataset
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.image_sources import holds_images, read_images
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError
from vislam_ros.frontend.settings import TrackerSettings

_LOADING = 0.8


def convert(
    data: Path,
    output: Path,
    *,
    conventions: Conventions = AS_FOUND,
    reference: Path | None = None,
    motion: Path | None = None,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
    frames: Frames = DEFAULT_FRAMES,
    tracks: bool = False,
    tracker: TrackerSettings | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Drive:
    """Write a dataset or images as a bag directory and return what was written.

    Images that are written are frames without features in what is returned.

    Parameters
    ----------
    data : Path
        A dataset of a known format, or images.
    output : Path
        The bag directory to make.
    conventions : Conventions, optional
        See :func:`vislam_ros.data.datasets.formats.read_dataset`.
    reference : Path, optional
        A TUM file that becomes the ground truth, cut to the dataset's time.
    motion : Path, optional
        For images, see :func:`vislam_ros.data.loading.load_passes`.
    topics, namespace : mapping of str to str, str, optional
        For bags with images, likewise.
    frames : Frames, optional
        Of the messages.
    tracks : bool, optional
        Write tracks of the images, and not the images themselves; so is done where only tracks
        can tell what the twists mean, of a course file without features.
    tracker : TrackerSettings, optional
        Of these tracks.
    force : bool
        Replace a bag that exists.
    progress : callable, optional
        Called with the share done.

    Raises
    ------
    VislamError
        Where an input cannot be used or the output not be written.
    """
    check_bag_output(output, force=force)
    report = progress or (lambda _share: None)
    if is_bag(data):
        require_intact(data)
    settings: dict[str, object] = dataclasses.asdict(conventions)
    if reference is not None:
        settings["reference"] = {"name": reference.name, "sha256": file_sha256(reference)}
    if not holds_images(data, motion, topics):
        drive = read_dataset(data, conventions=conventions, progress=_part(report, 0, _LOADING))
    else:
        images = read_images(
            data,
            motion,
            conventions=conventions,
            rules=ReadingRules(frames=frames),
            topics=topics,
            namespace=namespace,
        )
        # OpenCV takes a while to import, which others need not wait for.
        from vislam_ros.data.images.bags.writer import motion_drive, write_image_bag
        from vislam_ros.data.images.tracking import tracked_drive

        # Only tracks tell what such twists mean, and a bag is in this package's convention.
        if not tracks and images.unsettled is None:
            if reference is not None:
                truth = _clipped(reference, images.name, images.stamps)
                images = dataclasses.replace(images, ground_truth=truth)
            write_image_bag(
                images,
                output,
                source=data,
                settings=settings,
                force=force,
                frames=frames,
                progress=report,
            )
            return motion_drive(images)
        drive = tracked_drive(images, tracker, progress=_part(report, 0, _LOADING))
    if reference is not None:
        truth = _clipped(reference, drive.name, drive.feature_stamps)
        drive = dataclasses.replace(drive, ground_truth=truth)
    write_bag(
        drive,
        output,
        source=data,
        settings=settings,
        force=force,
        frames=frames,
        progress=_part(report, _LOADING, 1.0),
    )
    return drive


def _part(report: Progress, begin: float, end: float) -> Progress:
    """Report of a part of the whole."""
    return lambda share: report(begin + (end - begin) * share)


def _clipped(reference: Path, name: str, stamps: NDArray[np.int64]) -> Trajectory:
    """Poses of a reference in a drive's span of time, that of its frames' stamps (n,)."""
    truth = read_trajectory(reference)
    first, last = stamps[0], stamps[-1]
    inside = (truth.stamps >= first) & (truth.stamps <= last)
    if not inside.any():
        raise VislamError(
            f"{reference}: has no pose in the time of {name}, {first} to {last} ns: it "
            "belongs to another drive"
        )
    quaternions = truth.quaternions[inside]
    quaternions = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    return Trajectory(truth.stamps[inside], truth.positions[inside], quaternions)
