# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What one pass over the data holds: as it came, sorted by its stamps, and as a drive."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, Stream
from vislam_ros.core.tracking.stamp_pairs import StampPairs
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]
Frame: TypeAlias = tuple[int, NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32] | None]
T = TypeVar("T", bound=tuple[Any, ...])


@dataclass
class GatheredPass:
    """Decoded messages of one pass, each with its stamp (ns) first.

    Attributes
    ----------
    twists : list of (int, ndarray, ndarray or None)
        Twists (6,), or a gyroscope's samples as such, with the force (3,) that was measured beside
        them.
    turns : list of (int, ndarray)
        The IMU's angular velocities (3,) where they take the place of the twists' own.
    frames : list of (int, ndarray, ndarray, ndarray or None)
        Ids (n,), pixels (n, 4), and their noise (n,) where it is stated.
    poses : list of (int, ndarray, ndarray)
        Ground truth: position (3,) and quaternion (4,).
    camera : StereoCamera or None
        The one that was known at the first frame.
    rectification : PixelRectification or None
        What goes with it.
    refused : RefusalCounts
    """

    twists: list[tuple[int, Array, Array | None]] = field(default_factory=list)
    turns: list[tuple[int, Array]] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    poses: list[tuple[int, Array, Array]] = field(default_factory=list)
    camera: StereoCamera | None = None
    rectification: PixelRectification | None = None
    refused: RefusalCounts = field(default_factory=RefusalCounts)

    def sort(self, *, motion: Stream, imu_turns: bool) -> None:
        """Put each stream in the order of its stamps, and refuse what stands there twice.

        Parameters
        ----------
        motion : Stream
            That which measures it.
        imu_turns : bool
        """
        self.twists = self._sorted(self.twists, motion)
        self.frames = self._sorted(self.frames, Stream.FEATURES)
        self.poses = self._sorted(self.poses, None)
        if imu_turns:
            self._take_turns(self._sorted(self.turns, Stream.IMU))

    def _sorted(self, items: Iterable[T], stream: Stream | None) -> list[T]:
        kept: list[T] = []
        for item in sorted(items, key=itemgetter(0)):  # stable: the first to come stays first
            if not kept or item[0] > kept[-1][0]:
                kept.append(item)
            elif stream is not None:
                self.refused.add(stream, Refusal.DUPLICATE, item[0])
        return kept

    def _take_turns(self, turns: Sequence[tuple[int, Array]]) -> None:
        """Give each twist the angular velocity of its stamp, as imu_prediction_node does."""
        streams = (Stream.TWIST, Stream.IMU)
        pairs = StampPairs(
            lambda stream, stamp: self.refused.add(streams[stream], Refusal.UNPAIRED, stamp)
        )
        values = [(stamp, 0, twist) for stamp, twist, _ in self.twists]
        values += [(stamp, 1, omega) for stamp, omega in turns]
        self.twists = []
        for stamp, stream, value in sorted(values, key=itemgetter(0, 1)):
            if pair := pairs.add(stream, stamp, value):
                twist, omega = pair
                self.twists.append((stamp, np.concatenate([twist[:3], omega]), None))

    def has_motion(self) -> bool:
        """Whether the twists, sorted, reach any of the frames."""
        if not self.twists:
            return False
        first, last = self.twists[0][0], self.twists[-1][0]
        return any(first <= stamp <= last for stamp, *_ in self.frames)

    def drive(self, name: str, image_size: tuple[int, int], notes: Sequence[str]) -> Drive:
        """Drive of a sorted pass whose camera is known, its pixels rectified."""
        assert self.camera is not None
        seen = [(ids, pixels, noise) for _, ids, pixels, noise in self.frames]
        if self.rectification is not None:
            seen = [self.rectification.frame(*frame) for frame in seen]
        pixels = np.concatenate([np.empty((0, 4), np.float32), *(p for _, p, _ in seen)])
        return Drive(
            name=name,
            camera=self.camera,
            image_size=image_size if all(image_size) else image_size_that_holds(pixels),
            twist_stamps=_stamps(self.twists),
            twists=np.array([twist for _, twist, _ in self.twists]).reshape(-1, 6),
            accelerations=measured_forces([force for _, _, force in self.twists]),
            feature_stamps=_stamps(self.frames),
            offsets=np.cumsum([0, *(len(ids) for ids, _, _ in seen)], dtype=np.int64),
            ids=np.concatenate([np.empty(0, np.uint32), *(ids for ids, _, _ in seen)]),
            pixels=pixels,
            noise=_stated([noise for _, _, noise in seen]),
            ground_truth=_trajectory(self.poses) if self.poses else None,
            notes=tuple(notes),
            refused=self.refused,
        )


def _stated(noise: Sequence[NDArray[np.float32] | None]) -> NDArray[np.float32] | None:
    """Noise (n,) of all observations; None unless all frames state it."""
    stated = [values for values in noise if values is not None]
    return np.concatenate(stated) if stated and len(stated) == len(noise) else None


def measured_forces(forces: Sequence[Array | None]) -> Array | None:
    """Forces (N, 3), NaN where there is none; None where there are none at all."""
    if all(force is None for force in forces):
        return None
    return np.array([np.full(3, np.nan) if force is None else force for force in forces])


def _stamps(items: Sequence[tuple[Any, ...]]) -> NDArray[np.int64]:
    return np.array([item[0] for item in items], dtype=np.int64)


def _trajectory(poses: Sequence[tuple[int, Array, Array]]) -> Trajectory:
    return Trajectory(
        _stamps(poses),
        np.array([position for _, position, _ in poses]),
        np.array([quaternion for _, _, quaternion in poses]),
    )
