# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The inertial and GPS unit of KITTI's raw recordings: a file of numbers for each sample.

Its axes are x forward, y left, z up. The velocities along the way are told level with the ground,
so they are turned by roll and pitch into the unit's axes. Poses follow from latitude and longitude
by a Mercator projection scaled for the latitude of the first one (Geiger, Lenz, Stiller and
Urtasun, *Vision meets robotics: the KITTI dataset*, IJRR 2013).
"""

import math
import re
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.ranges import POSITION, TURN_RATE, VELOCITY
from vislam_ros.data.files.inputs import read_text
from vislam_ros.data.images.folders.numbered_files import frame_times, numbered_files
from vislam_ros.data.images.stereo_images import Motion
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_EARTH_RADIUS = 6378137.0  # metres, at the equator (WGS 84)
_TIME = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)(?:\.(\d{1,9}))?")
_LARGEST_SAMPLE = 1 << 12
# Where the numbers of a sample stand.
_LATITUDE, _LONGITUDE, _ALTITUDE, _ROLL, _PITCH, _YAW = range(6)
_LEVEL_VELOCITY, _ACCELERATION, _ANGULAR_VELOCITY = slice(8, 11), slice(11, 14), slice(17, 20)
_FEWEST = 20


class OxtsSamples(NamedTuple):
    """Motion of the unit, and its poses (n, 4, 4) in a world with x east, y north and z up."""

    motion: Motion
    T_world_imu: Array


def read_stamps(path: Path) -> NDArray[np.int64]:
    """Stamps (n,) of a ``timestamps.txt``, which is taken for UTC, nanoseconds.

    Raises
    ------
    VislamError
        Naming the line that is none.
    """
    form = "time as 2011-09-30 12:40:25.123456789"
    return np.array(frame_times(path, "these time stamps", _stamp, form), dtype=np.int64)


def read_oxts(folder: Path, notes: list[str]) -> OxtsSamples:
    """Read the samples of a folder with ``data`` and ``timestamps.txt``.

    Raises
    ------
    VislamError
        Naming the file and what is wrong with it.
    """
    times = folder / "timestamps.txt"
    all_stamps = read_stamps(times)
    files = numbered_files(folder / "data", (".txt",))
    if max(files) >= len(all_stamps):
        raise VislamError(f"{times}: has {len(all_stamps)} times, none for {max(files)}.txt")
    stamps = all_stamps[list(files)]
    samples = np.array([_sample(file) for file in files.values()])
    if late := int(np.sum(np.diff(stamps) < 0)):
        notes.append(f"Put the oxts samples in order: {late} had a time before the last one's.")
    times_once, order = np.unique(stamps, return_index=True)
    if repeated := len(stamps) - len(times_once):
        notes.append(f"Left out {repeated} oxts samples that repeat a time.")
    stamps, samples = times_once, samples[order]
    motion = Motion(stamps, _twists(samples, folder), samples[:, _ACCELERATION])
    return OxtsSamples(motion, _poses(samples, folder))


def _stamp(text: str) -> int:
    match = _TIME.fullmatch(text)
    if match is None:
        raise ValueError
    second = datetime.strptime(match[1], "%Y-%m-%d %H:%M:%S").replace(tzinfo=timezone.utc)
    return int(second.timestamp()) * NANOSECONDS + int((match[2] or "0").ljust(9, "0"))


def _sample(path: Path) -> list[float]:
    texts = read_text(path, "this sample", _LARGEST_SAMPLE).split()[:_FEWEST]
    try:
        row = [float(text) for text in texts]
    except ValueError:
        row = []
    if len(row) < _FEWEST or not all(map(math.isfinite, row)):
        raise VislamError(f"{path}: holds no {_FEWEST} finite numbers, as an oxts sample does")
    return row


def _twists(samples: Array, folder: Path) -> Array:
    from scipy.spatial.transform import Rotation  # slow to import, and for such recordings alone

    R_level_imu = Rotation.from_euler("YX", samples[:, [_PITCH, _ROLL]])
    velocities = R_level_imu.inv().apply(samples[:, _LEVEL_VELOCITY])
    VELOCITY.require(velocities, str(folder))
    TURN_RATE.require(samples[:, _ANGULAR_VELOCITY], str(folder))
    return np.column_stack([velocities, samples[:, _ANGULAR_VELOCITY]])


def _poses(samples: Array, folder: Path) -> Array:
    from scipy.spatial.transform import Rotation

    latitude, longitude = np.radians(samples[:, [_LATITUDE, _LONGITUDE]].T)
    if np.abs(latitude).max() >= np.pi / 2:
        raise VislamError(f"{folder}: has a latitude of 90 degrees or more")
    scale = np.cos(latitude[0])
    T_world_imu = np.tile(np.eye(4), (len(samples), 1, 1))
    T_world_imu[:, :3, :3] = Rotation.from_euler(
        "ZYX", samples[:, [_YAW, _PITCH, _ROLL]]
    ).as_matrix()
    T_world_imu[:, 0, 3] = scale * _EARTH_RADIUS * longitude
    T_world_imu[:, 1, 3] = scale * _EARTH_RADIUS * np.log(np.tan(np.pi / 4 + latitude / 2))
    T_world_imu[:, 2, 3] = samples[:, _ALTITUDE]
    POSITION.require(T_world_imu, str(folder))
    return T_world_imu
