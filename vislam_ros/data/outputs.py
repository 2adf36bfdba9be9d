# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that would destroy what they are made of, which no command writes."""

from contextlib import suppress
from pathlib import Path

from vislam_ros.data.results.file_names import OWNED_FILES
from vislam_ros.errors import VislamError

# What is drawn of results stands beside them, and may be drawn again.
_DRAWN = (".png", ".svg", ".html")


def refuse_loss(output: Path, source: Path, *, replaces_folder: bool = False) -> None:
    """Refuse an output that is an input, lies inside one, or would take one away.

    A bag and a folder of images hold what they hold: another file in them makes the bag's
    checksums wrong, or is taken for an image. Results may have others beside their own, such as
    pictures; and a result directory, written anew, takes with it only its own files of before.

    Parameters
    ----------
    output : Path
        That a command was told to write.
    source : Path
        That it was told to read.
    replaces_folder : bool
        An output that is a folder goes with all that is in it.

    Raises
    ------
    VislamError
        Naming both.
    """
    with suppress(OSError, RuntimeError, ValueError):  # no path; who reads or writes it says so
        target, read = output.resolve(), source.resolve()
        folder = _folder_of(read)
        is_of_results = (read / "summary.json").is_file()
        if target == read and not is_of_results:
            raise VislamError(
                f"{output}: is what this command reads: choose another output than {source}"
            )
        if folder is not None and folder in (target, *target.parents) and not is_of_results:
            raise VislamError(
                f"{output}: lies in {folder}, which this command reads and nothing may be added "
                "to: choose an output outside it"
            )
        if is_of_results and read in target.parents and _is_own(target):
            raise VislamError(
                f"{output}: is a file of {source}, which this command reads: choose another output"
            )
        if target in read.parents and (replaces_folder or _is_own(read)):
            raise VislamError(
                f"{output}: would replace {source}, which this command reads: choose another "
                "output"
            )


def _folder_of(read: Path) -> Path | None:
    """Folder that a source is, or whose file of a bag it is."""
    if read.is_dir():
        return read
    return read.parent if (read.parent / "metadata.yaml").is_file() else None


def _is_own(path: Path) -> bool:
    """Whether a file is of those that hold results."""
    return path.name in OWNED_FILES and path.suffix not in _DRAWN
