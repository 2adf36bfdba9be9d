# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The rows of the battery: which drive, how much of it, and what is done to it.

A chosen crossing, not a full one: recorded drives by the share of their tracks, their quarters,
cleaner twists and sliding tracks; simulated drives, walks and flights by features and rate; tracks
that the front end makes of images; and of each some with a gyroscope alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Twist = Literal["own", "clean", "clean, biased"]
Scene = Literal["drive", "walk", "flight", "take-off"]
Imagery = Literal["street", "room", "kitti_0020"]

#: Recorded drives with a reference, by the name of their file, and of the reference's.
REFERENCES = {
    "0020": "0020",
    "0022": "0022_pseudo",
    "0027": "0027",
    "10_synthetic": "10_synthetic",
}
#: Recorded images, with the motion and the reference of a recorded drive.
RECORDED_IMAGES: Imagery = "kitti_0020"

_ALONE = {False: (), True: ("gyroscope alone",)}
_DENSE = ("0022", "0027", "10_synthetic")
_QUARTERS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Recorded:
    """A recorded drive, or a part of it.

    Attributes
    ----------
    drive : str
        Name of its file, without the ending.
    percent : int
        Of its tracks that are used.
    quarter : int
        Which of its four parts; 0 is all of it.
    twist : str
        Its own, or one as clean as that of 0020, made from the reference.
    sliding : int
        Per cent of the tracks that slide over the scene.
    gyro : bool
        Whether a gyroscope alone measures the motion.
    """

    drive: str
    percent: int = 100
    quarter: int = 0
    twist: Twist = "own"
    sliding: int = 0
    gyro: bool = False

    @property
    def name(self) -> str:
        """What a table calls it."""
        parts = [self.drive, f"{self.percent} %"]
        if self.quarter:
            parts.append(f"quarter {self.quarter}")
        if self.twist != "own":
            parts.append(f"twist {self.twist}")
        if self.sliding:
            parts.append(f"{self.sliding} % slide")
        return ", ".join([*parts, *_ALONE[self.gyro]])

    @property
    def group(self) -> str:
        """The kind of row that it is."""
        if self.gyro:
            return "gyroscope alone"
        if self.sliding:
            return "sliding tracks"
        if self.twist != "own":
            return "clean twist"
        return "quarters" if self.quarter else "whole drives"


@dataclass(frozen=True)
class Simulated:
    """A simulated drive, walk or flight, or one that begins with a rest.

    Attributes
    ----------
    scene : str
    features : int
        In view, on average.
    rate : int
        Frames a second.
    noisy : bool
        Whether the twist is as noisy as on the course's files.
    sliding : int
        Per cent of the tracks that slide over the scene.
    gyro : bool
        Whether a gyroscope alone measures the motion.
    """

    scene: Scene
    features: int
    rate: int = 10
    noisy: bool = False
    sliding: int = 3
    gyro: bool = False

    @property
    def name(self) -> str:
        """What a table calls it."""
        parts = [f"simulated {self.scene}", f"{self.features} features", f"{self.rate} Hz"]
        if self.noisy:
            parts.append("noisy twist")
        if self.sliding != Simulated.sliding:
            parts.append(f"{self.sliding} % slide")
        return ", ".join([*parts, *_ALONE[self.gyro]])

    @property
    def group(self) -> str:
        """The kind of row that it is."""
        return f"simulated {self.scene}s{', gyroscope alone' if self.gyro else ''}"


@dataclass(frozen=True)
class Imaged:
    """Tracks that the front end makes of images.

    Attributes
    ----------
    scene : str
    hard : bool
        Whether simulated images are blurred and badly exposed, and much in them moves.
    gyro : bool
        Whether a gyroscope alone measures the motion.
    """

    scene: Imagery
    hard: bool = False
    gyro: bool = False

    @property
    def name(self) -> str:
        """What a table calls it."""
        parts = [f"images, {self.scene}", *(["hard"] if self.hard else [])]
        return ", ".join([*parts, *_ALONE[self.gyro]])

    @property
    def group(self) -> str:
        """The kind of row that it is."""
        return "images"


BatteryRow = Recorded | Simulated | Imaged


def all_rows() -> list[BatteryRow]:
    """Return the whole battery, in the order of its table."""
    rows: list[BatteryRow] = [Recorded("0020", percent) for percent in (33, 100)]
    rows += [Recorded(d, percent) for d in _DENSE for percent in (3, 5, 10, 33, 100)]
    rows += [Recorded("0020", 100, quarter) for quarter in _QUARTERS]
    rows += [Recorded(d, p, q) for d in _DENSE for p in (5, 33, 100) for q in _QUARTERS]
    clean: tuple[Twist, ...] = ("clean", "clean, biased")
    rows += [Recorded(d, p, twist=t) for d in _DENSE for p in (3, 10, 100) for t in clean]
    rows += [Recorded("0020", sliding=s) for s in (10, 25)]
    rows += [Recorded(d, p, sliding=s) for d in _DENSE for p in (3, 10, 33) for s in (10, 25)]
    rows += [Recorded(d, p, twist=t, sliding=25) for d in _DENSE for p in (3, 10) for t in clean]
    rows += [Simulated("drive", n, noisy=noisy) for n in (6, 20, 80) for noisy in (False, True)]
    in_rooms: tuple[Scene, ...] = ("walk", "flight")
    rows += [Simulated(s, n, hz) for s in in_rooms for n in (6, 20, 80) for hz in (10, 20, 30)]
    rows += [Simulated(s, n, 20, sliding=25) for s in in_rooms for n in (6, 20)]
    rows += [Simulated("take-off", n, 20) for n in (6, 20, 80)]
    rows += [Simulated("take-off", 20, 20, gyro=True), Simulated("take-off", 80, 10)]
    rows += [Recorded(d, p, gyro=True) for d in _DENSE for p in (10, 33, 100)]
    rows += [Simulated(s, n, 20, gyro=True) for s in in_rooms for n in (6, 20, 80)]
    rows += [Imaged(RECORDED_IMAGES, gyro=gyro) for gyro in (False, True)]
    scenes: tuple[Imagery, ...] = ("street", "room")
    rows += [
        Imaged(s, hard, gyro) for s in scenes for hard in (False, True) for gyro in (False, True)
    ]
    return rows


def quick_rows() -> list[BatteryRow]:
    """Return a few rows that are solved in a second each, to see that all works."""
    return [
        Recorded("0020", 100, 1),
        Recorded("0022", 5, 1),
        Simulated("drive", 6),
        Simulated("walk", 6),
    ]


def available(rows: Sequence[BatteryRow], data: Path) -> tuple[list[BatteryRow], list[str]]:
    """Split rows into those that can be solved and the names of the drives that others lack."""
    names = {row.drive for row in rows if isinstance(row, Recorded)}
    missing = {name for name in names if not all(map(Path.is_file, files_of(data, name)))}
    imagery = {row.scene for row in rows if isinstance(row, Imaged)}
    if RECORDED_IMAGES in imagery and not images_beside(data).is_dir():
        missing.add(RECORDED_IMAGES)
    solvable = [
        row
        for row in rows
        if getattr(row, "drive", None) not in missing
        and getattr(row, "scene", None) not in missing
    ]
    return solvable, sorted(missing)


def images_beside(data: Path) -> Path:
    """Where the recorded images lie: beside the folder of datasets."""
    return data.parent / "images" / RECORDED_IMAGES


def files_of(data: Path, drive: str) -> tuple[Path, Path]:
    """Return where a recorded drive and its reference lie."""
    return data / f"{drive}.npz", data / "ground_truth" / f"{REFERENCES[drive]}.tum"
