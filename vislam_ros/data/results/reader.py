# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A result directory in memory, also one whose run was killed while it wrote."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import KINDS
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.data.files.parameter_file import Parameters, read_parameters
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.data.results.summary import read_summary
from vislam_ros.data.results.writer import COVARIANCE_COLUMNS, UPPER_TRIANGLE
from vislam_ros.data.trajectory import Trajectory, parse_tum, stamp_from_text
from vislam_ros.errors import VislamError

# Columns of steps.csv in the first version; those that came later stand behind them.
_FIRST_COLUMNS = (
    *("stamp", "frozen", "active", "used", "rejected", "observed", "admitted", "landmarks"),
    *("nis", "nis_dof", "ms"),
)


@dataclass(frozen=True)
class Results:
    """What a run left behind.

    Attributes
    ----------
    directory : Path
    trajectory : Trajectory
        N poses.
    covariances : ndarray, (N, 6, 6)
        Body-frame covariance of ``[rho; theta]`` of each pose; NaN where it was not written.
    dead_reckoning, smoothed : Trajectory or None
    smoothed_covariances : ndarray, (K, 6, 6), or None
        Of the smoothed poses, in the same way.
    landmarks : LandmarkMap or None
    steps : dict of str to ndarray, (S,)
        Columns of ``steps.csv``; stamps in nanoseconds; empty where there is no such file. An
        older directory has fewer, but always those from ``stamp`` to ``ms``.
    summary : dict
    parameters : dict of str to dict
        Node, then name, then value; empty where there is no such file.
    """

    directory: Path
    trajectory: Trajectory
    covariances: NDArray[np.float64]
    dead_reckoning: Trajectory | None
    smoothed: Trajectory | None
    smoothed_covariances: NDArray[np.float64] | None
    landmarks: LandmarkMap | None
    steps: dict[str, NDArray[Any]]
    summary: dict[str, Any]
    parameters: Parameters

    @property
    def name(self) -> str:
        """The drive's name, or the directory's where it is not known."""
        return self.summary.get("drive") or self.directory.resolve().name


def read_results(directory: Path) -> Results:
    """Read a result directory; a last line that a kill cut short is left out.

    Raises
    ------
    VislamError
        Where the directory, its summary or its trajectory is missing, or a file is damaged.
    """
    if not directory.is_dir():
        raise VislamError(f"{directory}: no such result directory")
    summary = read_summary(directory / "summary.json")
    trajectory = _read_trajectory(directory / "trajectory.tum")
    if trajectory is None:
        raise VislamError(f"{directory / 'trajectory.tum'}: holds no pose: the run made no step")
    smoothed = _read_trajectory(directory / "smoothed.tum")
    landmarks, parameters = directory / "landmarks.npz", directory / "params.yaml"
    return Results(
        directory=directory,
        trajectory=trajectory,
        covariances=_read_covariances(directory / "trajectory_covariance.csv", trajectory),
        dead_reckoning=_read_trajectory(directory / "dead_reckoning.tum"),
        smoothed=smoothed,
        smoothed_covariances=(
            None
            if smoothed is None
            else _read_covariances(directory / "smoothed_covariance.csv", smoothed)
        ),
        landmarks=read_landmarks(landmarks) if landmarks.exists() else None,
        steps=_read_steps(directory / "steps.csv"),
        summary=summary,
        parameters=read_parameters(parameters) if parameters.exists() else {},
    )


def _whole_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines of a file but a last one without its end; none where there is no file."""
    if path.exists():
        yield from ((number, line) for number, line, is_whole in read_lines(path) if is_whole)


def _read_trajectory(path: Path) -> Trajectory | None:
    lines = _whole_lines(path)
    first = next(lines, None)
    return parse_tum(itertools.chain([first], lines), path) if first else None


def _read_table(
    path: Path, first_columns: tuple[str, ...]
) -> tuple[list[str], list[tuple[int, list[float]]]]:
    """Columns of a CSV file that must begin with some, and of each row its stamp and the rest."""
    lines = _whole_lines(path)
    _, header = next(lines, (1, ",".join(first_columns)))
    columns = header.split(",")
    if tuple(columns[: len(first_columns)]) != first_columns:
        raise VislamError(f"{path}: line 1 must begin with {','.join(first_columns)}")
    table = []
    for number, line in lines:
        row = line.split(",")
        parsed = _parsed(row) if len(row) == len(columns) else None
        if parsed is None:
            raise VislamError(
                f"{path}: line {number} is {','.join(row)!r}: it must hold {len(columns)} "
                "numbers, the first a finite time in seconds"
            )
        table.append(parsed)
    return columns, table


def _parsed(row: list[str]) -> tuple[int, list[float]] | None:
    try:
        return stamp_from_text(row[0]), [float(field) for field in row[1:]]
    except ValueError:
        return None


def _read_covariances(path: Path, trajectory: Trajectory) -> NDArray[np.float64]:
    covariances = np.full((len(trajectory), 6, 6), np.nan)
    rows = dict(_read_table(path, COVARIANCE_COLUMNS)[1])
    i, j = UPPER_TRIANGLE
    for k, stamp in enumerate(trajectory.stamps.tolist()):
        if stamp in rows:
            covariances[k, i, j] = covariances[k, j, i] = rows[stamp][: len(i)]
    return covariances


def _read_steps(path: Path) -> dict[str, NDArray[Any]]:
    columns, table = _read_table(path, _FIRST_COLUMNS)
    values = np.array([row for _, row in table]).reshape(len(table), len(columns) - 1)
    steps: dict[str, NDArray[Any]] = {"stamp": np.array([s for s, _ in table], dtype=np.int64)}
    for column, name in enumerate(columns[1:]):
        steps[name] = values[:, column].astype(KINDS.get(name, float))
    return steps
