# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the ASL format: a stamp in nanoseconds, then names or numbers, with commas between."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.files.inputs import read_lines
from vislam_ros.errors import VislamError


def read_names(path: Path) -> dict[int, str]:
    """File name for each stamp (ns) of a camera's ``data.csv``, in the order of the stamps.

    Raises
    ------
    VislamError
        Naming the file and the line.
    """
    names: dict[int, str] = {}
    for number, fields in _rows(path):
        stamp = _stamp(path, number, fields[0])
        name = fields[1] if len(fields) > 1 else ""
        if not name or "/" in name or "\0" in name:
            raise VislamError(
                f"{path}: line {number} names no file after its stamp, but {name[:40]!r}: give "
                "the name of one in data"
            )
        names.setdefault(stamp, name)
    if not names:
        raise VislamError(f"{path}: holds no row of a stamp and a file's name")
    return dict(sorted(names.items()))


def read_numbers(
    path: Path, columns: int, notes: list[str]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Stamps (n,), strictly increasing, and the first ``columns`` numbers after each.

    Rows come in the order of their stamps; a second one of a stamp is left out and noted.

    Raises
    ------
    VislamError
        Naming the file and the line.
    """
    rows: dict[int, list[float]] = {}
    repeated = 0
    for number, fields in _rows(path):
        stamp = _stamp(path, number, fields[0])
        row = _parsed(float, fields[1 : columns + 1])
        if row is None or len(row) < columns or not np.all(np.isfinite(row)):
            raise VislamError(
                f"{path}: line {number} is no row of a stamp and {columns} finite numbers"
            )
        repeated += stamp in rows
        rows.setdefault(stamp, row)
    if not rows:
        raise VislamError(f"{path}: holds no row of a stamp and {columns} numbers")
    where = f"{path.parent.name}/{path.name}"
    if repeated:
        notes.append(f"Left out {repeated} rows of {where} that repeat a stamp.")
    stamps = np.array(list(rows), dtype=np.int64)
    order = np.argsort(stamps)
    if late := int(np.sum(np.diff(stamps) < 0)):
        notes.append(
            f"Put the rows of {where} in order: {late} had a stamp before the last one's."
        )
    return stamps[order], np.array(list(rows.values()))[order]


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    for number, line, _ in read_lines(path, "this table"):
        text = line.strip()
        # Columns that a program names have no # before them.
        names_columns = number == 1 and text[:1].isalpha()
        if text and not text.startswith("#") and not names_columns:
            yield number, [field.strip() for field in text.split(",")]


def _stamp(path: Path, number: int, text: str) -> int:
    # 19 digits and a sign: longer ones are no time, and slow to read.
    stamp = _parsed(int, [text]) if len(text) <= 20 else None
    if stamp is None or not 0 <= stamp[0] <= np.iinfo(np.int64).max:
        raise VislamError(
            f"{path}: line {number} begins with {text[:40]!r}, no stamp in nanoseconds and a comma"
        )
    return int(stamp[0])


def _parsed(kind: Callable[[str], float], texts: list[str]) -> list[float] | None:
    try:
        return [kind(text) for text in texts]
    except ValueError:
        return None
