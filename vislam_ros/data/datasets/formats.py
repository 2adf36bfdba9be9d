# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The formats of datasets: each is a file of two functions, ``matches(path)`` and ``read(path)``.

One from outside the package is registered, or named on the command line with ``--format``.
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from vislam_ros.data.datasets import npz, tracks_file
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.errors import VislamError
from vislam_ros.outside import import_outside, in_a_line


class DatasetFormat(Protocol):
    """A module, or whatever else has these two.

    ``read`` may take the keywords ``conventions`` and ``progress``, too, and is then told what
    the command line says of axes and twists, and whom to tell the share read so far.
    """

    @property
    def matches(self) -> Callable[[Path], bool]:
        """Whether a path, which may not exist, is a dataset of this format."""

    @property
    def read(self) -> Callable[..., Drive]:
        """The drive of a path that matches; a VislamError tells what is wrong with it."""


_formats: list[DatasetFormat] = [tracks_file, npz]


def register_dataset(dataset_format: DatasetFormat) -> None:
    """Make a format known; the one registered last is asked first.

    Parameters
    ----------
    dataset_format : module or object
        Has the functions ``matches(path)``, which tells whether a :class:`~pathlib.Path` is of
        this format, and ``read(path)``, which gives its :class:`~vislam_ros.data.drive.Drive`.

    Raises
    ------
    VislamError
        Where it lacks one.
    """
    if not all(callable(getattr(dataset_format, name, None)) for name in ("matches", "read")):
        raise VislamError(f"{_name_of(dataset_format)}: a format has matches(path) and read(path)")
    if dataset_format not in _formats:
        _formats.insert(0, dataset_format)


def import_format(module: str) -> None:
    """Import a format and register it.

    Raises
    ------
    VislamError
        Where there is no such module, or it is no format.
    """
    register_dataset(import_outside(module))


def format_of(path: Path) -> DatasetFormat | None:
    """Find the format of a dataset; None where no format is its."""
    return next((each for each in _formats if each.matches(path)), None)


def read_dataset(
    path: Path, *, conventions: Conventions = AS_FOUND, progress: Progress | None = None
) -> Drive:
    """Read a dataset of whatever format.

    Parameters
    ----------
    path : Path
    conventions : Conventions, optional
        What the dataset's numbers mean, for a format that leaves it open.
    progress : callable, optional
        Told the share read so far, 0 to 1, by a format that does so.

    Raises
    ------
    VislamError
        Where the dataset cannot be read, or is of no known format.
    """
    dataset_format = format_of(path)
    if dataset_format is None:
        raise VislamError(f"{path}: is no dataset of a known format, as .npz or .npy are")
    options = {"conventions": conventions, "progress": progress}
    taken = inspect.signature(dataset_format.read).parameters
    try:
        drive = dataset_format.read(
            path, **{name: value for name, value in options.items() if name in taken}
        )
    except VislamError:
        raise
    except Exception as error:  # of whatever kind: it may not be our code
        reason = in_a_line(error)
        raise VislamError(
            f"{path}: cannot be read as {_name_of(dataset_format)}: {reason}"
        ) from error
    if not isinstance(drive, Drive):
        raise VislamError(f"{path}: {_name_of(dataset_format)} read {drive!r}, which is no Drive")
    return drive


def _name_of(dataset_format: object) -> str:
    return str(getattr(dataset_format, "__name__", type(dataset_format).__name__))
