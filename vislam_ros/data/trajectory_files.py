# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of trajectories by whatever program: read as what they are, written as others want them.

| format | a line |
|---|---|
| TUM | ``t x y z qx qy qz qw``, seconds or nanoseconds |
| EuRoC's csv (ASL) | ``t, x, y, z, qw, qx, qy, qz`` in nanoseconds, and what may follow |
| KITTI | the first three rows of the pose's matrix, without a time |
"""

from collections.abc import Iterable, Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.files.inputs import read_lines
from vislam_ros.data.files.whole_file import refuse_existing, replace_files
from vislam_ros.data.trajectory import (
    LATEST_SECOND,
    NANOSECONDS,
    Trajectory,
    parse_tum,
    stamp_text,
    tum_text,
)
from vislam_ros.errors import VislamError

FileFormat: TypeAlias = Literal["tum", "euroc", "kitti"]

FILE_FORMATS: tuple[FileFormat, ...] = get_args(FileFormat)

_EUROC_HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
    "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
)
_KITTI_NUMBERS = 12


def read_trajectory(path: Path | str) -> Trajectory:
    """Read a TUM file, in seconds or nanoseconds, or EuRoC's csv; the file says which it is.

    Seconds end where 64-bit nanoseconds do, in the year 2262: stamps beyond are nanoseconds.

    Raises
    ------
    VislamError
        Where the file is missing, is empty, has a line that is no pose, or its stamps do not
        increase.
    """
    path = Path(path)
    lines = ((number, line) for number, line, _ in read_lines(path, "this trajectory"))
    return parse_tum(_tum_lines(lines, path), path)


def _tum_lines(lines: Iterable[tuple[int, str]], path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a TUM file in seconds that say the same."""
    is_csv = is_nanoseconds = None
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if is_csv is None:
            is_csv = "," in line
            if is_csv and not _is_number(line.split(",")[0]):
                continue  # a header without its #
        fields = _euroc_fields(line, number, path) if is_csv else line.split()
        if len(fields) == _KITTI_NUMBERS:
            raise VislamError(
                f"{path}: line {number} holds twelve numbers: KITTI's poses have no times: give "
                "a TUM file, of poses with their times"
            )
        if is_nanoseconds is None:
            is_nanoseconds = is_csv or (_is_number(fields[0]) and float(fields[0]) > LATEST_SECOND)
        yield number, " ".join([_seconds(fields[0]), *fields[1:]] if is_nanoseconds else fields)


def _euroc_fields(line: str, number: int, path: Path) -> list[str]:
    """Fields of a row in the order of TUM's."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) < 8 or not all(fields):
        raise VislamError(
            f"{path}: line {number} is {line!r}: a row of EuRoC's csv holds eight numbers or "
            "more, t x y z qw qx qy qz"
        )
    stamp, x, y, z, qw, qx, qy, qz, *_ = fields
    if _is_number(stamp) and float(stamp) % 1 > 0:
        raise VislamError(
            f"{path}: line {number} has commas, and the stamp {stamp}: EuRoC's csv has whole "
            "nanoseconds and qw before qx; for a TUM file, in seconds and qx qy qz qw, put blanks "
            "in place of the commas"
        )
    return [stamp, x, y, z, qx, qy, qz, qw]


def _seconds(text: str) -> str:
    """Seconds, exactly, of a number of nanoseconds; the text where it is none."""
    # A decimal of a thousand digits' exponent would make an integer as long.
    if not (_is_number(text) and 0 <= float(text) < LATEST_SECOND * NANOSECONDS):
        return text
    return stamp_text(int(Decimal(text)))


def _is_number(text: str) -> bool:
    try:
        float(text)
        Decimal(text)
    except (ValueError, InvalidOperation):
        return False
    return True


def write_trajectory(
    path: Path, trajectory: Trajectory, file_format: FileFormat, *, force: bool = False
) -> list[Path]:
    """Write a trajectory for another program to read.

    Parameters
    ----------
    path : Path
        For ``kitti``, whose poses have no times, ``NAME_times.txt`` stands beside ``NAME.txt``:
        seconds, a line for each pose.
    trajectory : Trajectory
    file_format : str
        ``tum``, ``euroc`` or ``kitti``.
    force : bool
        Replace files that exist.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    VislamError
        Where a file exists and ``force`` is not given, or cannot be written.
    """
    stamps = trajectory.stamps.tolist()
    if file_format == "tum":
        texts = {path: tum_text(trajectory)}
    elif file_format == "euroc":
        rows = np.hstack([trajectory.positions, trajectory.quaternions[:, [3, 0, 1, 2]]])
        texts = {path: _EUROC_HEADER + _lines(rows, ",", [f"{stamp}," for stamp in stamps])}
    else:
        rows = trajectory.T_world_body[:, :3].reshape(len(trajectory), _KITTI_NUMBERS)
        times = path.with_name(f"{path.stem}_times{path.suffix}")
        texts = {
            path: _lines(rows, " "),
            times: "".join(f"{stamp_text(stamp)}\n" for stamp in stamps),
        }
    for each in texts:
        refuse_existing(each, force=force)
    replace_files({each: text.encode("ascii") for each, text in texts.items()})
    return list(texts)


def _lines(rows: NDArray[np.float64], separator: str, starts: Iterable[str] | None = None) -> str:
    """Lines of numbers with the fewest digits that read back to the same float."""
    starts = [""] * len(rows) if starts is None else starts
    return "".join(
        f"{start}{separator.join(map(repr, row))}\n"
        for start, row in zip(starts, rows.tolist(), strict=True)
    )


def of_camera(trajectory: Trajectory, T_body_camera: NDArray[np.float64]) -> Trajectory:
    """Poses of a camera on the body, in the frame where the camera was first, as KITTI has them.

    Parameters
    ----------
    trajectory : Trajectory
        Of the body.
    T_body_camera : ndarray, (4, 4)
        The camera in the body.
    """
    T_world_camera = trajectory.T_world_body @ T_body_camera
    return Trajectory.from_matrices(
        trajectory.stamps, se3.inverse(T_world_camera[0]) @ T_world_camera
    )
