# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Directories that appear whole or not at all."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from vislam_ros.data.files.whole_file import made_directory, refuse_existing
from vislam_ros.errors import VislamError


def check_output(output: Path, *, force: bool, replaceable: Callable[[Path], bool]) -> None:
    """Refuse an output that exists, unless it may be replaced.

    Parameters
    ----------
    output : Path
    force : bool
        The user asked to replace what is there.
    replaceable : callable
        Tells whether what is there is of a kind that may go; guards a mistyped path.

    Raises
    ------
    VislamError
    """
    refuse_existing(output, force=force)
    if not output.exists():
        return
    is_empty_directory = output.is_dir() and not any(output.iterdir())
    if not (is_empty_directory or replaceable(output)):
        raise VislamError(
            f"{output}: is not of the kind that would replace it: remove it yourself or choose "
            "another name"
        )


@contextmanager
def whole_directory(
    output: Path, *, force: bool, replaceable: Callable[[Path], bool]
) -> Iterator[Path]:
    """Give a path to make a directory at; it becomes ``output`` if the block ends well.

    The path ends with the same name as ``output`` and lies in a hidden directory beside it,
    ``.NAME.XXXX.partial``, which is removed in any case but a kill. What is replaced goes only
    when the new directory is complete.

    Parameters are those of :func:`check_output`.

    Raises
    ------
    VislamError
        Where the output exists and is not to be replaced, or cannot be written.
    """
    check_output(output, force=force, replaceable=replaceable)
    target = output.resolve()
    try:
        with made_directory(target.parent):
            scratch = Path(
                tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent)
            )
            try:
                work = scratch / target.name
                yield work
                _put_in_place(work, target, scratch / "replaced")
            finally:
                shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        raise VislamError(f"{output}: cannot write it: {error.strerror or error}") from error


def _put_in_place(work: Path, target: Path, replaced: Path) -> None:
    try:
        if target.exists():
            target.rename(replaced)
        work.rename(target)
    except BaseException:
        if replaced.exists() and not target.exists():
            replaced.rename(target)
        raise
