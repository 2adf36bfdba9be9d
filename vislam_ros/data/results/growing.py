# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A result directory that is being written: its new steps, at each look."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.results.writer import UPPER_TRIANGLE
from vislam_ros.data.trajectory import stamp_from_text

Array = NDArray[np.float64]


class GrowingStep(NamedTuple):
    """A step as its rows tell it.

    Attributes
    ----------
    stamp : int
        Nanoseconds.
    position, quaternion : ndarray, (3,), (4,)
        Body in the map, metres; x, y, z, w.
    covariance : ndarray, (6, 6)
        Of ``[rho; theta]`` on the right of the pose.
    row : dict of str to float
        Columns of ``steps.csv`` but the stamp.
    """

    stamp: int
    position: Array
    quaternion: Array
    covariance: Array
    row: dict[str, float]


class GrowingResults:
    """Reads what has come to the rows of a directory since the last look.

    It never waits and never fails: what is not there yet, or is no row, is left for later or out.

    Parameters
    ----------
    directory : Path
    """

    def __init__(self, directory: Path):
        self.directory = directory
        self._poses = _GrowingFile(directory / "trajectory.tum")
        self._covariances = _GrowingFile(directory / "trajectory_covariance.csv")
        self._steps = _GrowingFile(directory / "steps.csv")
        self._columns: list[str] = []
        self._pose_of: dict[str, list[str]] = {}
        self._covariance_of: dict[str, list[str]] = {}

    def new_steps(self) -> list[GrowingStep]:
        """Return the steps that are whole by now and were not at the last look, in order."""
        # A step's rows are written in the order of pose, covariance, step: asked for backwards,
        # none of them is missing to a step that is seen.
        rows = [line.split(",") for line in self._steps.new_lines()]
        self._covariance_of |= {
            cells[0]: cells
            for cells in (line.split(",") for line in self._covariances.new_lines())
        }
        self._pose_of |= {
            cells[0]: cells
            for cells in (line.split() for line in self._poses.new_lines())
            if cells
        }
        if not self._columns and rows:
            self._columns = rows.pop(0)
        found = []
        for row in rows:
            pose = self._pose_of.pop(row[0], None)
            covariance = self._covariance_of.pop(row[0], None)
            if pose is not None and covariance is not None:
                step = self._step(pose, covariance, row)
                if step is not None:
                    found.append(step)
        return found

    def _step(self, pose: list[str], covariance: list[str], row: list[str]) -> GrowingStep | None:
        try:
            x, y, z, *quaternion = map(float, pose[1:])
            Sigma = np.zeros((6, 6))
            Sigma[UPPER_TRIANGLE] = list(map(float, covariance[1:]))
            numbers = dict(zip(self._columns[1:], map(float, row[1:]), strict=True))
            stamp = stamp_from_text(row[0])
        except ValueError:
            return None
        Sigma = np.triu(Sigma) + np.triu(Sigma, 1).T
        return GrowingStep(stamp, np.array([x, y, z]), np.array(quaternion), Sigma, numbers)


class _GrowingFile:
    """A file of lines that others append to."""

    def __init__(self, path: Path):
        self._path = path
        self._offset = 0

    def new_lines(self) -> list[str]:
        """Return the lines that have been ended since the last call."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._offset)
                content = file.read()
        except OSError:
            return []
        whole = content[: content.rfind(b"\n") + 1]
        self._offset += len(whole)
        return whole.decode("ascii", errors="replace").splitlines()
