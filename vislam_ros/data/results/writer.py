# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result directory, written as the run goes, by ``vislam solve`` and the recorder alike.

Every row goes to the system as soon as it is whole, so a killed run loses none of them. The map
and the summary are replaced as whole files, about once a second.
"""

import csv
import io
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import Row
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.files.open_file import append, require_present
from vislam_ros.data.files.parameter_file import write_parameters
from vislam_ros.data.files.whole_file import make_directory, remove_directories, replace_file
from vislam_ros.data.results.file_names import OWNED_FILES
from vislam_ros.data.results.landmark_map import write_landmarks, write_point_cloud
from vislam_ros.data.results.summary import RunSummary
from vislam_ros.data.trajectory import Trajectory, stamp_text, tum_line, tum_text
from vislam_ros.errors import OutputError, VislamError

_TANGENT = ("x", "y", "z", "rx", "ry", "rz")
UPPER_TRIANGLE = np.triu_indices(6)
#: Upper triangle of the body-frame covariance of [rho; theta], row by row.
COVARIANCE_COLUMNS = (
    "stamp",
    *(f"{_TANGENT[i]}_{_TANGENT[j]}" for i, j in zip(*UPPER_TRIANGLE, strict=True)),
)

#: Of ``parameter_changes.csv``, values as JSON has them.
CHANGE_COLUMNS = ("stamp", "node", "parameter", "before", "value")

_REFRESH_PERIOD = 1.0  # seconds


def refuse_used(directory: Path, *, force: bool) -> None:
    """Raise a VislamError where a result directory holds anything and may not be replaced."""
    if not force and directory.is_dir() and any(directory.iterdir()):
        raise VislamError(f"{directory}: is not empty: choose another directory or add --force")


def pass_directory(directory: Path, number: int) -> Path:
    """Where the results of a pass over the data stand, from 1: in ``pass_NNN`` but for the first.

    A pass ends where time jumps back, as in a looping bag, or where the estimate was reset.
    """
    return directory if number == 1 else directory / f"pass_{number:03d}"


def pass_directories(directory: Path) -> list[Path]:
    """Result directories of all passes that there are, the first one first."""
    return [directory, *sorted(directory.glob("pass_[0-9][0-9][0-9]"))]


def note_on_passes(directory: Path) -> str | None:
    """Line on the passes behind the first one, whose results a directory holds, or None."""
    folders = pass_directories(directory)[1:]
    names = [folder.name for folder in folders if (folder / "summary.json").exists()]
    if not names:
        return None
    others = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    return f"{directory}: the first of {1 + len(names)} passes; the rest is in {others}"


class ResultWriter:
    """Writes a result directory; a context manager.

    Leaving the context without :meth:`finish` marks the results as incomplete, as after an
    interrupt; an error in it takes them away again.

    Parameters
    ----------
    directory : Path
        Made where it is missing.
    force : bool
        Take a directory that is not empty and remove what an earlier run left there, in its
        ``pass_NNN`` folders too. Other files are never touched.
    started : float, optional
        ``time.monotonic()`` at the start of the whole command, for ``total_s``; now by default.

    Attributes
    ----------
    summary : RunSummary
        Set here what the rows do not tell: refused messages, memory, and so on.

    Raises
    ------
    VislamError
        Where the directory is in use.
    OutputError
        From any method, where a file cannot be written or is no longer there.
    """

    def __init__(
        self, directory: Path, *, force: bool = False, started: float | None = None
    ) -> None:
        self.directory = directory
        self.summary = RunSummary() if started is None else RunSummary(started)
        self._files: dict[str, io.FileIO] = {}
        self._columns: dict[str, Sequence[str]] = {}
        self._last_stamps: dict[str, int] = {}
        self._unwritten_landmarks: LandmarkMap | None = None
        self._finished = False
        try:
            refuse_used(directory, force=force)
            self._made = make_directory(directory)
            for folder in pass_directories(directory):
                for name in OWNED_FILES:
                    (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"{directory}: cannot be a result directory: {error.strerror}"
            ) from error
        try:
            self.flush()
        except VislamError:
            self.discard()
            raise

    def __enter__(self) -> "ResultWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._finished:
            return
        if kind and issubclass(kind, Exception):
            self.discard()
            return
        reason = "the run was left before its end"
        if kind:
            reason = f"{kind.__name__}: {error}".rstrip(": ")
        self.finish(complete=False, incomplete_reason=reason)

    def discard(self) -> None:
        """Remove what was written, and the directories that were made for it."""
        self._finished = True
        for file in self._files.values():
            file.close()
        with suppress(OSError):
            for name in OWNED_FILES:
                (self.directory / name).unlink(missing_ok=True)
        remove_directories(self._made)

    def add_step(
        self,
        position: ArrayLike,
        quaternion: ArrayLike,
        covariance_body: ArrayLike,
        row: Row,
    ) -> None:
        """Add a pose of the estimate, and what its step did.

        Parameters
        ----------
        position : array_like, (3,)
            Metres.
        quaternion : array_like, (4,)
            x, y, z, w.
        covariance_body : array_like, (6, 6)
            Of the error ``[rho; theta]`` on the right of the pose.
        row : Row
            Numbers of the step by column; its stamp is the pose's.

        Raises
        ------
        ValueError
            Where the stamp is not later than the one before (begin another directory when time
            jumps back), or the columns are others.
        """
        stamp = int(row["stamp"])
        self._append_pose("trajectory.tum", stamp, position, quaternion)
        self._append_row(
            "trajectory_covariance.csv",
            COVARIANCE_COLUMNS,
            _covariance_row(stamp, np.asarray(covariance_body, dtype=float)),
        )
        cells: dict[str, object] = {
            name: int(value) if isinstance(value, bool) else value for name, value in row.items()
        }
        cells["stamp"] = stamp_text(stamp)
        self._append_row("steps.csv", tuple(cells), tuple(cells.values()))
        self.summary.add_step(row)
        self.refresh()

    def add_dead_reckoning(self, stamp: int, position: ArrayLike, quaternion: ArrayLike) -> None:
        """Add a pose of the prediction at a stamp (ns); the rest as for :meth:`add_step`."""
        self._append_pose("dead_reckoning.tum", stamp, position, quaternion)
        self.refresh()

    def add_change(self, stamp: int, node: str, name: str, before: Any, value: Any) -> None:
        """Add a parameter that changed: its value before, and that from a step's stamp (ns) on."""
        row = (stamp_text(stamp), node, name, json.dumps(before), json.dumps(value))
        self._append_row("parameter_changes.csv", CHANGE_COLUMNS, row)
        self.summary.parameter_changes += 1

    def set_landmarks(self, landmarks: LandmarkMap) -> None:
        """Replace the map, on disk within about a second of further rows, or at a flush."""
        self._unwritten_landmarks = landmarks
        self.summary.landmarks = len(landmarks)
        self.summary.tracks = len(np.unique(landmarks.ids))
        self.refresh()

    def set_smoothed(self, trajectory: Trajectory, covariances: ArrayLike) -> None:
        """Write the smoothed poses and their covariances (N, 6, 6), as for :meth:`add_step`."""
        replace_file(self.directory / "smoothed.tum", tum_text(trajectory).encode("ascii"))
        table = io.StringIO()
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(COVARIANCE_COLUMNS)
        rows.writerows(map(_covariance_row, trajectory.stamps.tolist(), np.asarray(covariances)))
        replace_file(self.directory / "smoothed_covariance.csv", table.getvalue().encode("ascii"))

    def set_parameters(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        """Write ``params.yaml`` from node names to parameter names to values."""
        write_parameters(self.directory / "params.yaml", parameters)
        self.summary.estimator = parameters.get("slam_node", {}).get(
            "estimator", self.summary.estimator
        )

    def refresh(self) -> None:
        """Flush if the last flush is a second old; call it from a timer where rows may pause."""
        if time.monotonic() - self._flushed >= _REFRESH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Bring the map and the summary on disk up to date; the rows always are."""
        if self._unwritten_landmarks is not None:
            write_landmarks(self.directory / "landmarks.npz", self._unwritten_landmarks)
            write_point_cloud(self.directory / "landmarks.ply", self._unwritten_landmarks)
            self._unwritten_landmarks = None
        write_json(self.directory / "summary.json", self.summary.as_dict())
        for name, file in self._files.items():
            if not file.closed:
                try:
                    require_present(self.directory / name, file)
                except OSError as error:
                    raise self._error(name, error) from error
        self._flushed = time.monotonic()

    def finish(self, *, complete: bool, incomplete_reason: str | None = None) -> None:
        """Close the directory, saying whether the run ended whole and, if not, why."""
        self._finished = True
        for file in self._files.values():
            file.close()
        self.summary.complete = complete
        self.summary.incomplete_reason = None if complete else incomplete_reason
        self.flush()

    def _append_pose(
        self, name: str, stamp: int, position: ArrayLike, quaternion: ArrayLike
    ) -> None:
        last = self._last_stamps.get(name)
        if last is not None and stamp <= last:
            raise ValueError(f"{name}: stamp {stamp} is not later than {last}")
        self._last_stamps[name] = stamp
        row = tum_line(stamp, np.asarray(position).tolist(), np.asarray(quaternion).tolist())
        self._append(name, f"{row}\n")

    def _append_row(self, name: str, columns: Sequence[str], row: Sequence[object]) -> None:
        line = io.StringIO()
        table = csv.writer(line, lineterminator="\n")
        if name not in self._columns:
            self._columns[name] = columns
            table.writerow(columns)
        if columns != self._columns[name]:
            raise ValueError(f"{name}: the columns are no longer {', '.join(self._columns[name])}")
        table.writerow(row)
        self._append(name, line.getvalue())

    def _append(self, name: str, lines: str) -> None:
        """Write whole lines at once, so that a kill tears none."""
        try:
            if name not in self._files:
                self._files[name] = (self.directory / name).open("wb", buffering=0)
            append(self._files[name], lines.encode("ascii"))
        except OSError as error:
            raise self._error(name, error) from error

    def _error(self, name: str, error: OSError) -> OutputError:
        path = self.directory / name
        return OutputError(f"{path}: cannot write to this file: {error.strerror}")


def _covariance_row(stamp: int, covariance: NDArray[np.float64]) -> list[object]:
    return [stamp_text(stamp), *covariance[UPPER_TRIANGLE].tolist()]
