# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that are written over a long time: whole lines, and no writing into what is deleted."""

import errno
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import IO


def append(file: io.FileIO, content: bytes) -> None:
    """Hand content to the system in one write, which a kill cannot tear.

    Raises
    ------
    OSError
        Where it does not fit; then none of it is there.
    """
    done = 0
    try:
        while done < len(content):
            done += file.write(content[done:])
    except OSError:
        with suppress(OSError):
            file.truncate(file.seek(-done, os.SEEK_CUR))
        raise


def require_present(path: Path, file: IO[bytes] | io.FileIO) -> None:
    """Raise an OSError where an open file is no longer the one at its path.

    The system goes on taking what is written to a deleted file, and nobody will ever read it.
    """
    if not os.path.samestat(path.stat(), os.fstat(file.fileno())):
        raise FileNotFoundError(errno.ENOENT, "it was replaced while it was being written")
