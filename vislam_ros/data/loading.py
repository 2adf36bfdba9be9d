# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive from whatever a command is given: a dataset or a bag."""

from collections.abc import Mapping
from pathlib import Path

from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.reader import is_bag, read_drive
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import format_of, read_dataset
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.errors import VislamError


def load_drive(
    path: Path | str,
    *,
    conventions: Conventions = AS_FOUND,
    topics: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Drive:
    """Read a drive from a dataset or, after a look at its integrity, from a bag.

    Parameters
    ----------
    path : Path or str
    conventions : Conventions, optional
        For datasets, see :func:`~vislam_ros.data.datasets.formats.read_dataset`. A bag is in this
        package's convention.
    topics : mapping of str to str, optional
        For bags, see :func:`vislam_ros.data.bags.reader.read_drive`.
    progress : callable, optional
        For datasets, called with the share done.

    Raises
    ------
    VislamError
        Where the path is neither, is damaged or cannot be read.
    """
    path = Path(path)
    if format_of(path):
        return read_dataset(path, conventions=conventions, progress=progress)
    if is_bag(path):
        require_intact(path)
        return read_drive(path, topics=topics)
    if not path.exists():
        raise VislamError(f"{path}: no such file or directory")
    raise VislamError(
        f"{path}: is neither a dataset of a known format (as .npz, .npy) nor a bag (a directory "
        "with metadata.yaml, or .mcap)"
    )
