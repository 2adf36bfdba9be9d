# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The way to Rerun: the library where it is installed, a viewer on the screen, or a file."""

import os
import shutil
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from vislam_ros.data.files.whole_file import made_directory, refuse_existing
from vislam_ros.errors import OutputError, VislamError

#: A ``rerun.RecordingStream``; the library need not be installed.
Stream: TypeAlias = Any

#: The one timeline: seconds from the first pose.
TIMELINE = "time"

_APPLICATION = "vislam"


def rerun() -> ModuleType:
    """The library.

    Raises
    ------
    VislamError
        Where it is not installed.
    """
    try:
        import rerun
    except ImportError as error:
        raise VislamError(
            "the viewer needs rerun-sdk, which is not installed: pip install 'vislam_ros[view]' "
            "(Python 3.11 or later)"
        ) from error
    return rerun


@contextmanager
def opened_stream(name: str, save: Path | None = None, *, force: bool = False) -> Iterator[Stream]:
    """Open a recording that a viewer shows while it comes in, or that goes to a file.

    The file is there when the block has ended well, and not before.

    Parameters
    ----------
    name : str
        What the viewer calls it.
    save : Path, optional
        A file to write in place of opening a viewer.
    force : bool
        Replace a file that exists.

    Raises
    ------
    VislamError
        Where the library is missing, there is no screen for a viewer, it does not start, or the
        file exists and ``force`` is not given.
    OutputError
        Where the file cannot be written.
    """
    check_stream(save, force=force)
    stream = rerun().RecordingStream(_APPLICATION)
    if save is None:
        try:
            rerun().spawn(executable_path=_program(), recording=stream)
        except RuntimeError as error:
            reason = str(error).partition("\n")[0]
            raise VislamError(f"the viewer does not start: {reason}") from error
        stream.send_recording_name(name)
        yield stream
        stream.flush()
        return
    with _finished_file(save) as unfinished:
        try:
            stream.save(unfinished)
        except (OSError, RuntimeError) as error:
            raise OutputError(f"{save}: cannot write this file: {error}") from error
        try:
            stream.send_recording_name(name)
            yield stream
            stream.flush()
        finally:
            stream.disconnect()


@contextmanager
def _finished_file(path: Path) -> Iterator[Path]:
    """Give a file to write, which comes to its place when the block has ended well."""
    unfinished = path.with_name(f".{path.name}.tmp")
    try:
        with made_directory(path.parent):
            try:
                yield unfinished
                unfinished.replace(path)
            finally:
                unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot write this file: {error.strerror}") from error


def check_stream(save: Path | None, *, force: bool) -> None:
    """Raise a VislamError where :func:`opened_stream` is going to, before anything is read."""
    rerun()
    if save is None:
        require_screen()
    else:
        refuse_existing(save, force=force)


def _program() -> str | None:
    """The viewer's program beside this Python, which need not be on the PATH; None where not."""
    return shutil.which("rerun", path=sysconfig.get_path("scripts"))


def require_screen() -> None:
    """Raise a VislamError where a window has no place to open."""
    on_linux = sys.platform.startswith("linux")
    if on_linux and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise VislamError(
            "there is no screen for the viewer (DISPLAY is not set): write a file for it with "
            "--save FILE.rrd"
        )
