# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Finished runs of a sweep, one line of JSON each, so that a sweep goes on where it was left."""

import fcntl
import hashlib
import json
import os
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from vislam_ros.data.files.inputs import check_regular
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.data.sweeps.run import Row, SweepInputs
from vislam_ros.errors import VislamError

RUNS, IDENTITY = "runs.jsonl", "sweep.json"
#: All that a sweep leaves in its directory.
SWEEP_FILES = (IDENTITY, RUNS, "table.csv", "sweep.png")


def identity_of(inputs: SweepInputs) -> dict[str, Any]:
    """What makes two sweeps one: the same drive, truth and map, smoothed or not."""
    drive = inputs.drive
    return {
        "drive": None if drive is None else drive.name,
        "sha256": _digest(inputs),
    }


def _digest(value: Any) -> str:
    content = hashlib.sha256()

    def add(part: Any) -> None:
        if is_dataclass(part):
            for item in fields(part):
                # A drive and its bag differ in what their readers tell about them.
                if item.name not in ("name", "notes"):
                    content.update(item.name.encode())
                    add(getattr(part, item.name))
        elif isinstance(part, np.ndarray):
            content.update(f"{part.dtype}{part.shape}".encode())
            content.update(np.ascontiguousarray(part).tobytes())
        else:
            content.update(repr(part).encode())

    add(value)
    return content.hexdigest()


class SweepLog:
    """The directory of a sweep; a context manager that one process holds at a time.

    Parameters
    ----------
    directory : Path
        Made where it is missing.
    identity : dict
        See :func:`identity_of`.
    force : bool
        Begin anew, whatever sweep the directory is of. Files that no sweep makes stay.

    Attributes
    ----------
    rows : dict of str to Row
        The last row of each run, by key.

    Raises
    ------
    VislamError
        Where the directory is another sweep's, holds other things, is in use by a running sweep
        or cannot be written, or a row is damaged.
    """

    def __init__(self, directory: Path, identity: dict[str, Any], *, force: bool = False) -> None:
        self.directory = directory
        self.rows: dict[str, Row] = {}
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise VislamError(f"{directory}: cannot hold a sweep: {error.strerror}") from error
        try:
            self._take_lock()
            for file in (directory / IDENTITY, directory / RUNS):
                if file.exists():
                    check_regular(file, "this sweep")
            if force:
                for name in SWEEP_FILES:
                    (directory / name).unlink(missing_ok=True)
            else:
                self._check(identity)
            replace_file(directory / IDENTITY, (json.dumps(identity) + "\n").encode())
            self._file = (directory / RUNS).open("a+b", buffering=0)
            self._read()
        except BaseException as error:
            os.close(self._lock)
            if isinstance(error, OSError):
                raise VislamError(f"{directory}: cannot write here: {error.strerror}") from error
            raise

    def __enter__(self) -> "SweepLog":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()
        os.close(self._lock)

    def append(self, row: Row) -> None:
        """Add a row; once this returns, no kill can undo it."""
        line = json.dumps(row, allow_nan=False) + "\n"
        try:
            self._file.write(line.encode())
        except OSError as error:
            raise VislamError(f"{self._file.name}: cannot write: {error.strerror}") from error
        self.rows[row["key"]] = row

    def _take_lock(self) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise VislamError(f"{self.directory}: another sweep is writing here") from error

    def _check(self, identity: dict[str, Any]) -> None:
        if not any(self.directory.iterdir()):
            return
        try:
            there = json.loads((self.directory / IDENTITY).read_bytes())
        except FileNotFoundError:
            raise VislamError(
                f"{self.directory}: is not empty and holds no sweep: choose another directory or "
                "add --force"
            ) from None
        except ValueError:
            there = None
        if there != identity:
            raise VislamError(
                f"{self.directory}: holds a sweep over another drive, truth or map, or one with "
                "another --smooth: choose another directory, or add --force to begin anew"
            )

    def _read(self) -> None:
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        # A kill may have cut the last line; its run was not finished for anyone.
        self._file.truncate(whole)
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            row = self._row(number, line)
            self.rows[row["key"]] = row

    def _row(self, number: int, line: bytes) -> Row:
        try:
            row = json.loads(line)
        except ValueError:
            row = None
        if not isinstance(row, dict) or not {"key", "error"} <= row.keys():
            raise VislamError(
                f"{self._file.name}, line {number}: not the row of a run: delete this line"
            )
        return row
