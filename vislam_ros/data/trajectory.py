# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories and the TUM file: eight columns ``t x y z qx qy qz qw``, as evo reads them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.ranges import LARGEST_POSITION
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.errors import VislamError, path_like

NANOSECONDS = 1_000_000_000

#: The year 2261, where 64-bit nanoseconds end.
LATEST_SECOND = 9_200_000_000

# A quaternion is of length 1, but for how it was rounded or scaled.
_SHORTEST_QUATERNION = 1e-3
# A body that moves by no more than this in a step stands, metres.
_STANDING = 0.02


@dataclass(frozen=True)
class Trajectory:
    """Stamped poses of the body in a world frame.

    Attributes
    ----------
    stamps : ndarray of int64, (N,)
        Nanoseconds, strictly increasing.
    positions : ndarray, (N, 3)
        Metres.
    quaternions : ndarray, (N, 4)
        x, y, z, w.
    covariances : ndarray, (N, 6, 6), or None
        Of the pose errors ``[rho; theta]`` on the right, where they are known.
    """

    stamps: NDArray[np.int64]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]
    covariances: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.stamps)

    def __repr__(self) -> str:
        known = "" if self.covariances is None else ", with covariances"
        return f"<Trajectory: {len(self)} poses, {extent(self)}{known}>"

    @property
    def duration(self) -> float:
        """Seconds from the first pose to the last."""
        return float(self.stamps[-1] - self.stamps[0]) * 1e-9 if len(self) else 0.0

    @property
    def T_world_body(self) -> NDArray[np.float64]:
        """Poses as homogeneous matrices, (N, 4, 4)."""
        return se3.pose_matrix(self.positions, self.quaternions)

    @classmethod
    def from_matrices(
        cls, stamps: NDArray[np.int64], T_world_body: NDArray[np.float64]
    ) -> "Trajectory":
        """Build a trajectory from stamps (N,) in nanoseconds and poses (N, 4, 4)."""
        return cls(
            np.asarray(stamps, dtype=np.int64),
            np.array(T_world_body[:, :3, 3]),
            se3.quaternion_from_rotation(T_world_body[:, :3, :3]),
        )

    def between(self, rows: NDArray[np.int64]) -> "Trajectory":
        """Return all poses from the first to the last of some rows, without covariances."""
        part = slice(int(np.min(rows)), int(np.max(rows)) + 1)
        return Trajectory(self.stamps[part], self.positions[part], self.quaternions[part])


def path_length(trajectory: Trajectory) -> float:
    """Length of the path through all positions, metres."""
    return float(np.sum(np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)))


def extent(trajectory: Trajectory) -> str:
    """Seconds and metres of a trajectory, in words."""
    return f"{trajectory.duration:.1f} s, {path_length(trajectory):.1f} m"


def moving_steps(T_world_body: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell whether a body has moved to each of its poses (n, 4, 4); to the first it has not.

    A step to or from a pose that is not known, NaN, counts as motion.
    """
    way = np.linalg.norm(np.diff(T_world_body[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[False], ~(way <= _STANDING)])


def nanoseconds(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Nearest nanosecond to each time (T,) in seconds: of the float's own value, unrounded."""
    whole = np.floor(seconds)
    fraction = np.rint((seconds - whole) * NANOSECONDS)
    return whole.astype(np.int64) * NANOSECONDS + fraction.astype(np.int64)


def stamp_text(stamp: int) -> str:
    """Seconds with nine decimals, exactly, of a stamp in nanoseconds that is not negative."""
    return f"{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d}"


def stamp_from_text(text: str) -> int:
    """Nanoseconds of a decimal number of seconds, exactly to the ninth decimal.

    Raises
    ------
    ValueError
        Where it is no number, or no time in seconds.
    """
    if not abs(float(text)) <= LATEST_SECOND:
        raise ValueError(f"{text} is no time in seconds")
    whole, _, fraction = text.partition(".")
    if not (whole.isdigit() and (fraction.isdigit() or not fraction)):
        return round(float(text) * NANOSECONDS)
    return int(whole) * NANOSECONDS + int(fraction[:9].ljust(9, "0"))


def tum_line(stamp: int, position: Iterable[float], quaternion: Iterable[float]) -> str:
    """One line of a TUM file, without its end.

    Numbers are written with the fewest digits that read back to the same float, so equal
    trajectories are equal files.
    """
    numbers = " ".join(repr(float(value)) for value in (*position, *quaternion))
    return f"{stamp_text(stamp)} {numbers}"


def tum_text(trajectory: Trajectory) -> str:
    """Text of a TUM file."""
    lines = map(tum_line, trajectory.stamps.tolist(), trajectory.positions, trajectory.quaternions)
    return "".join(f"{line}\n" for line in lines)


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write a TUM file."""
    path.write_text(tum_text(trajectory), encoding="ascii")


def read_tum(path: Path | str) -> Trajectory:
    """Read a TUM file; empty lines and lines that begin with # are passed over.

    Raises
    ------
    VislamError
        Where the file is missing, is empty, has a line without eight finite numbers, or its
        stamps do not increase.
    """
    path = Path(path_like("path", path))
    return parse_tum(((n, line) for n, line, _ in read_lines(path, "this trajectory")), path)


def parse_tum(lines: Iterable[tuple[int, str]], path: Path) -> Trajectory:
    """Trajectory of a TUM file's numbered lines; errors name ``path`` (see :func:`read_tum`)."""
    stamps: list[int] = []
    rows: list[list[float]] = []
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = line.split()
        try:
            stamp, row = _parsed_line(fields)
        except ValueError:
            raise VislamError(
                f"{path}: line {number} is {line!r}: a TUM line holds eight finite numbers, "
                f"t x y z qx qy qz qw: seconds from 0 to {LATEST_SECOND:g}, metres up to "
                f"{LARGEST_POSITION:g} and a quaternion"
            ) from None
        if stamps and stamp <= stamps[-1]:
            raise VislamError(
                f"{path}: line {number} has stamp {fields[0]}, not later than the line before: "
                f"{'leave one of the two out' if stamp == stamps[-1] else 'sort the file by time'}"
            )
        stamps.append(stamp)
        rows.append(row)
    if not rows:
        raise VislamError(f"{path}: holds no pose: a TUM file has lines t x y z qx qy qz qw")
    values = np.array(rows)
    return Trajectory(np.array(stamps, dtype=np.int64), values[:, :3], values[:, 3:])


def _parsed_line(fields: list[str]) -> tuple[int, list[float]]:
    """Stamp (ns), position and quaternion; a ValueError where they are none."""
    if len(fields) != 8:
        raise ValueError
    stamp, row = stamp_from_text(fields[0]), [float(field) for field in fields[1:]]
    length = math.hypot(*row[3:])
    # Comparisons with NaN are false.
    if not (stamp >= 0 and all(abs(x) <= LARGEST_POSITION for x in row[:3])):
        raise ValueError
    if not _SHORTEST_QUATERNION <= length <= 1 / _SHORTEST_QUATERNION:
        raise ValueError
    return stamp, row
