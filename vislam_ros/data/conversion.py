# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a dataset or images, and a reference where there is one, to a bag."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import file_sha256, require_intact
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, Frames
from vislam_ros.data.bags.reader import ReadingRules
from vislam_ros.data.bags.writer import check_bag_output, write_bag
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import read_dataset
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.image_sources import is_images
from vislam_ros.data.images.bags import reader as bag
from vislam_ros.data.loading import load_images
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError

_LOADING_SHARE = 0.8


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
    force: bool = False,
    progress: Progress | None = None,
) -> Drive:
    """Write a dataset as a bag directory and return what was written.

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

    def reading(share: float) -> None:
        report(_LOADING_SHARE * share)

    if is_bag(data):
        require_intact(data)
    if is_images(data) or (is_bag(data) and bag.matches(data, topics)):
        drive = load_images(
            data,
            motion,
            conventions=conventions,
            rules=ReadingRules(frames=frames),
            topics=topics,
            namespace=namespace,
            progress=reading,
        )
    elif motion is not None and data.exists():
        raise VislamError(f"{data}: holds no images: leave out --motion, which is for these")
    else:
        drive = read_dataset(data, conventions=conventions, progress=reading)
    settings: dict[str, object] = dataclasses.asdict(conventions)
    if reference is not None:
        drive = dataclasses.replace(drive, ground_truth=_clipped(reference, drive))
        settings["reference"] = {"name": reference.name, "sha256": file_sha256(reference)}
    write_bag(
        drive,
        output,
        source=data,
        settings=settings,
        force=force,
        frames=frames,
        progress=lambda share: report(_LOADING_SHARE + (1.0 - _LOADING_SHARE) * share),
    )
    return drive


def _clipped(reference: Path, drive: Drive) -> Trajectory:
    """Poses of a reference in a drive's span of time."""
    truth = read_trajectory(reference)
    first, last = drive.feature_stamps[0], drive.feature_stamps[-1]
    inside = (truth.stamps >= first) & (truth.stamps <= last)
    if not inside.any():
        raise VislamError(
            f"{reference}: has no pose in the time of {drive.name}, {first} to {last} ns: it "
            "belongs to another drive"
        )
    quaternions = truth.quaternions[inside]
    quaternions = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    return Trajectory(truth.stamps[inside], truth.positions[inside], quaternions)
