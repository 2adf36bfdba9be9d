# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of whatever kind a command is given, and the motion for them from another file."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from vislam_ros.data.bags.bag_messages import BagMessages, is_bag
from vislam_ros.data.bags.bag_messages import lacks as bag_lacks
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.reader import DEFAULT_RULES, ReadingRules, read_passes
from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.arrays.array_stream import open_arrays
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import format_of, read_dataset
from vislam_ros.data.images.bags import reader as bag
from vislam_ros.data.images.bags.topics import has_features
from vislam_ros.data.images.folders import asl, course, kitti_odometry, kitti_raw
from vislam_ros.data.images.given_motion import GivenMotion, with_motion
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.errors import VislamError

_FOLDERS = (asl, kitti_raw, kitti_odometry)
_KINDS = (
    "an EuRoC/ASL folder (mav0), a KITTI folder (image_0, image_1, calib.txt; or image_00, "
    "image_01, oxts), a course file with its _imgs.npy, or a bag with images"
)


def is_images(path: Path) -> bool:
    """Whether a path is a folder or a file of images; for bags :func:`bag.matches` tells."""
    return any(each.matches(path) for each in _FOLDERS) or course.matches(path)


def holds_images(
    path: Path, motion: Path | str | None = None, topics: Mapping[str, str] | None = None
) -> bool:
    """Tell whether a path, bags included, holds images; arguments as :func:`read_images`.

    Raises
    ------
    VislamError
        Where there is a motion for what holds none, a bag cannot be opened, or a folder is of a
        kind that is known, and something of it is missing.
    """
    if is_images(path) or (is_bag(path) and bag.matches(path, topics)):
        return True
    _require_whole(path)
    if motion is not None and path.exists():
        raise VislamError(f"{path}: holds no images: leave out --motion, which is for these")
    return False


def read_images(
    path: Path,
    motion: Path | None = None,
    *,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
) -> StereoImages:
    """Open images, with their motion; a bag's damage is not looked for here.

    Parameters
    ----------
    path : Path
        A folder, a course file or a bag with images; also a dataset with its images beside it.
    motion : Path, optional
        A dataset or a bag with the motion, the times and the extrinsics, in place of those that
        the images have.
    conventions : Conventions, optional
        For datasets.
    rules, topics, namespace : ReadingRules, mapping of str to str, str, optional
        For bags, see :func:`vislam_ros.data.bags.reader.read_passes`.

    Raises
    ------
    VislamError
        Where they cannot be read, fit to no motion, or are of cameras that are no pair.
    """
    images = _opened(path, motion, conventions, rules, topics, namespace)
    # It brings OpenCV, which takes a while to import.
    from vislam_ros.frontend.rectification import Rectification

    try:
        Rectification(images.rig)
    except VislamError as error:
        raise VislamError(f"{path}: {error}") from error
    return images


def _opened(
    path: Path,
    motion: Path | None,
    conventions: Conventions,
    rules: ReadingRules,
    topics: Mapping[str, str] | None,
    namespace: str,
) -> StereoImages:
    of_bags = (rules, dict(topics or {}), namespace)
    given = None if motion is None else read_motion(motion, conventions, *of_bags)
    for each in _FOLDERS:
        if each.matches(path):
            return _with(each.read(path), given)
    images = path if course.matches(path) else course.images_of(path)
    if images is not None:
        dataset = course.dataset_of(images)
        if given is None and dataset is not None:
            given = read_motion(dataset, conventions, *of_bags)
        return course.read(images, given)
    if is_bag(path):
        opened = bag.read(
            path,
            frames=rules.frames,
            topics=topics,
            namespace=namespace,
            needs_extrinsics=given is None or given.camera is None,
        )
        return _with(opened, given)
    if not path.exists():
        raise VislamError(f"{path}: no such file or directory")
    _require_whole(path)
    raise VislamError(f"{path}: holds no images: give {_KINDS}")


def _require_whole(path: Path) -> None:
    """Refuse a folder of a kind that is known of which something is missing, and say what."""
    if format_of(path) is None and not is_bag(path):
        for lacks in (*(each.lacks for each in _FOLDERS), bag_lacks):
            if missing := lacks(path):
                raise VislamError(missing)


def read_motion(
    path: Path,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
) -> GivenMotion:
    """Read the motion of a dataset or of a bag; arguments and errors as :func:`read_images`."""
    dataset_format = format_of(path)
    if dataset_format is npz:
        return _dataset_motion(path, conventions)
    if dataset_format:
        return GivenMotion.of_drive(read_dataset(path, conventions=conventions), str(path))
    if not is_bag(path):
        what = "is neither a dataset nor a bag" if path.exists() else "no such file or directory"
        raise VislamError(f"{path}: {what}: --motion takes one of these")
    require_intact(path)
    of_motion = {ours: name for ours, name in (topics or {}).items() if "image" not in ours}
    if has_features(_msgtypes(path)):
        first, *_ = read_passes(path, rules=rules, topics=of_motion, namespace=namespace)
        return GivenMotion.of_drive(first, str(path))
    return bag.read_motion(path, frames=rules.frames, topics=of_motion, namespace=namespace)


def _dataset_motion(path: Path, conventions: Conventions) -> GivenMotion:
    with open_arrays(path) as arrays:
        has_features = npz.FEATURES in arrays
    as_given = replace(conventions, imu_frame="as-given", twist_index="end", twist_origin="body")
    drive, rectification = npz.read_with_rectification(
        path, conventions if has_features else as_given
    )
    given = GivenMotion.of_drive(drive, str(path), rectification)
    if has_features:
        return given
    if len(drive.twists) < drive.steps:
        raise VislamError(
            f"{path}: {drive.steps - len(drive.twists)} of its {drive.steps} samples of motion "
            "have a NaN, and images tell its axes by one for each of them: fill these in, or "
            "leave their rows out"
        )
    notes = tuple(note for note in given.notes if note != npz.NO_FEATURES)
    return replace(given, unsettled=conventions, notes=notes)


def _with(images: StereoImages, given: GivenMotion | None) -> StereoImages:
    return images if given is None else with_motion(images, given)


def _msgtypes(path: Path) -> dict[str, str]:
    with BagMessages(path) as messages:
        return {connection.topic: connection.msgtype for connection in messages.connections}
