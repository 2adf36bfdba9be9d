# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders in which a file's name is the number of its frame, as in KITTI's."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from vislam_ros.data.files.inputs import read_lines
from vislam_ros.errors import VislamError

T = TypeVar("T")

_IMAGES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp")
_MOST_DIGITS = 18


def numbered_files(folder: Path, suffixes: tuple[str, ...] = _IMAGES) -> dict[int, Path]:
    """Files of a folder by the numbers that are their names, in the order of the numbers.

    Raises
    ------
    VislamError
        Where the folder cannot be read or holds none.
    """
    try:
        names = sorted(folder.iterdir())
    except OSError as error:
        raise VislamError(f"{folder}: cannot read this folder: {error.strerror}") from error
    files = {
        int(each.stem): each
        for each in names
        if each.suffix.lower() in suffixes
        and each.stem.isascii()
        and each.stem.isdigit()
        and len(each.stem) <= _MOST_DIGITS
    }
    if not files:
        raise VislamError(f"{folder}: holds no file such as 000000{suffixes[0]}")
    return dict(sorted(files.items()))


def frame_times(path: Path, what: str, parse: Callable[[str], T], form: str) -> list[T]:
    """Times of a file that has one on each line, that of the frame with the line's number.

    Parameters
    ----------
    path : Path
    what : str
        What to call the file where it cannot be read.
    parse : callable
        Makes a time of a text, or raises a ValueError.
    form : str
        What a line that is none is not.

    Raises
    ------
    VislamError
        As :func:`vislam_ros.data.files.inputs.read_lines`, for a line that is no time, and for a
        blank one before others: these would be of other frames without it.
    """
    times: list[T] = []
    blank = 0
    for number, line, _ in read_lines(path, what):
        if not line.strip():
            blank = blank or number
            continue
        if blank:
            raise VislamError(
                f"{path}: line {blank} is blank, and each line is the time of a frame: write it, "
                "or take the line out"
            )
        time = _parsed(parse, line.strip())
        if time is None:
            raise VislamError(f"{path}: line {number} is {line!r:.50}, no {form}")
        times.append(time)
    return times


def _parsed(parse: Callable[[str], T], text: str) -> T | None:
    try:
        return parse(text)
    except ValueError:
        return None


def numbered_pairs(
    left: Path, right: Path, notes: list[str]
) -> tuple[list[int], list[tuple[Path, Path]]]:
    """Numbers, increasing, and files of the images that are in both folders.

    Raises
    ------
    VislamError
        As :func:`numbered_files`, and where no number is in both.
    """
    lefts, rights = numbered_files(left), numbered_files(right)
    common = [number for number in lefts if number in rights]
    if not common:
        raise VislamError(f"{left}: holds no image that has the name of one in {right.name}")
    if alone := len(lefts) + len(rights) - 2 * len(common):
        notes.append(f"Left out {alone} images without one of the other camera.")
    return common, [(lefts[number], rights[number]) for number in common]
