# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive from whatever a command is given: a dataset, a bag, or images."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.reader import DEFAULT_RULES, ReadingRules, read_passes
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import format_of, read_dataset
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.image_sources import holds_images, read_images
from vislam_ros.errors import VislamError, path_like
from vislam_ros.frontend.settings import TrackerSettings


def load_passes(
    path: Path | str,
    *,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
    motion: Path | str | None = None,
    tracker: TrackerSettings | None = None,
    progress: Progress | None = None,
) -> tuple[Drive, ...]:
    """Read the drives of a dataset or of images, which is one, or of a bag: one for each pass.

    Parameters
    ----------
    path : Path or str
    conventions : Conventions, optional
        For datasets, see :func:`~vislam_ros.data.datasets.formats.read_dataset`. A bag is in this
        package's convention.
    rules, topics, namespace : ReadingRules, mapping of str to str, str, optional
        For bags, see :func:`vislam_ros.data.bags.reader.read_passes`.
    motion : Path or str, optional
        For images, a dataset or a bag with their motion, see
        :func:`vislam_ros.data.image_sources.read_images`.
    tracker : TrackerSettings, optional
        For images.
    progress : callable, optional
        For datasets and images, called with the share done.

    Raises
    ------
    VislamError
        Where the path is neither, is damaged or cannot be read.
    """
    path = Path(path_like("path", path))
    of_bag = is_bag(path)
    if of_bag:
        require_intact(path)
    if holds_images(path, motion, topics):
        drive = load_images(
            path,
            motion,
            conventions=conventions,
            rules=rules,
            topics=topics,
            namespace=namespace,
            tracker=tracker,
            progress=progress,
        )
        return (drive,)
    if format_of(path):
        return (read_dataset(path, conventions=conventions, progress=progress),)
    if of_bag:
        return read_passes(path, rules=rules, topics=topics, namespace=namespace)
    if not path.exists():
        raise VislamError(f"{path}: no such file or directory")
    raise VislamError(
        f"{path}: is neither a dataset of a known format (as .npz, .npy) nor a bag (a directory "
        "with metadata.yaml, or .mcap), nor a folder of images (EuRoC/ASL, KITTI)"
    )


def load_drive(
    path: Path | str,
    *,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
    motion: Path | str | None = None,
    tracker: TrackerSettings | None = None,
    progress: Progress | None = None,
) -> Drive:
    """Read a drive, the first pass of :func:`load_passes`, with its arguments and errors."""
    first, *others = load_passes(
        path,
        conventions=conventions,
        rules=rules,
        topics=topics,
        namespace=namespace,
        motion=motion,
        tracker=tracker,
        progress=progress,
    )
    if others:
        note = f"The stamps begin anew: this is the first of {len(others) + 1} passes."
        return replace(first, notes=(*first.notes, note))
    return first


def load_images(
    path: Path,
    motion: Path | str | None = None,
    *,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
    tracker: TrackerSettings | None = None,
    progress: Progress | None = None,
    picture: Path | None = None,
) -> Drive:
    """Track features through images, see :func:`vislam_ros.data.image_sources.read_images`.

    A bag's damage is not looked for here. The tracks in the middle image are drawn to ``picture``.
    """
    images = read_images(
        path,
        None if motion is None else Path(motion),
        conventions=conventions,
        rules=rules,
        topics=topics,
        namespace=namespace,
    )
    # OpenCV takes a while to import, which others need not wait for.
    from vislam_ros.data.images.track_picture import TrackPicture
    from vislam_ros.data.images.tracking import tracked_drive

    if picture is None:
        return tracked_drive(images, tracker, progress)
    drawn = TrackPicture(len(images) // 2)
    drive = tracked_drive(images, tracker, progress, drawn.add)
    drawn.write(picture)
    return drive
