# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are either whole or not there: written beside their place, then renamed into it."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from vislam_ros.errors import OutputError, VislamError


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise a VislamError where ``path`` exists and may not be replaced."""
    if path.exists() and not force:
        raise VislamError(f"{path}: exists already: choose another output or add --force")


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader, or a kill at any moment, finds the old or the new one whole.

    Raises
    ------
    OutputError
        Where it cannot be written; nothing of it is left then.
    """
    replace_files({path: content})


def replace_files(contents: Mapping[Path, bytes]) -> None:
    """Write files: all of them or, where one cannot be written, none; as :func:`replace_file`."""
    temporaries: dict[Path, Path] = {}
    path = next(iter(contents))
    try:
        for path, content in contents.items():
            temporaries[path] = path.with_name(f".{path.name}.tmp")
            temporaries[path].write_bytes(content)
        for path, temporary in temporaries.items():
            temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write this file: {error.strerror}") from error
    finally:
        for temporary in temporaries.values():
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def made_directory(path: Path) -> Iterator[None]:
    """Make a directory and its parents where they are missing; they go if the block fails."""
    made = make_directory(path)
    try:
        yield
    except BaseException:
        remove_directories(made)
        raise


def make_directory(path: Path) -> list[Path]:
    """Make a directory and its parents; return those that were missing, the innermost first."""
    missing = [each for each in (path, *path.parents) if not each.exists()]
    path.mkdir(parents=True, exist_ok=True)
    return missing


def remove_directories(made: Iterable[Path]) -> None:
    """Remove directories that are empty, the innermost first."""
    with suppress(OSError):
        for directory in made:
            directory.rmdir()
