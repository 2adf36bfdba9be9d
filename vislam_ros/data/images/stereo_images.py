# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive in images: pairs that are read one after the other, with what else is known of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.ranges import PERIOD
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError
from vislam_ros.frontend.turns import turn_between


class RawImage(NamedTuple):
    """Pixels (H, W) or (H, W, channels), 8 or 16 bits, and their encoding in ROS's words."""

    pixels: NDArray[Any]
    encoding: str


class StereoPair(NamedTuple):
    """Both images of a moment: its stamp in nanoseconds, left and right."""

    stamp: int
    left: RawImage
    right: RawImage


#: Opens the pairs at some places, increasing, of all that there are, in this order.
PairReader = Callable[[Sequence[int]], Iterator[tuple[RawImage, RawImage]]]


@dataclass(frozen=True)
class Motion:
    """What the body's motion was measured as.

    Attributes
    ----------
    stamps : ndarray of int64, (N,)
        Nanoseconds, strictly increasing. A sample stands for the time that ends at its stamp.
    twists : ndarray, (N, 6)
        ``[v; omega]`` in the body frame, metres and radians a second; v is NaN where the velocity
        is not measured.
    accelerations : ndarray, (N, 3), or None
        Specific force in the body frame, m/s^2; NaN where it was not measured.
    """

    stamps: NDArray[np.int64]
    twists: NDArray[np.float64]
    accelerations: NDArray[np.float64] | None = None

    def during(self, stamps: NDArray[np.int64]) -> "Motion":
        """Samples in the time of some stamps, increasing, and those just before and after."""
        first = max(int(np.searchsorted(self.stamps, stamps[0], side="right")) - 1, 0)
        last = int(np.searchsorted(self.stamps, stamps[-1], side="left")) + 1
        rows = slice(first, max(last, first + 1))
        accelerations = None if self.accelerations is None else self.accelerations[rows]
        return Motion(self.stamps[rows], self.twists[rows], accelerations)

    def turn_between(self, begin: int, end: int) -> NDArray[np.float64] | None:
        """Rotation (3, 3) of the body between two stamps (ns), or None where unknown."""
        return turn_between(self.stamps, self.twists[:, 3:], begin, end)

    @classmethod
    def of_imu(
        cls,
        stamps: NDArray[np.int64],
        angular_velocities: NDArray[np.float64],
        accelerations: NDArray[np.float64] | None = None,
    ) -> "Motion":
        """Motion of an IMU's samples: angular velocities (N, 3), accelerations (N, 3) or none."""
        unknown = np.full(angular_velocities.shape, np.nan)
        return cls(stamps, np.column_stack([unknown, angular_velocities]), accelerations)


@dataclass(frozen=True)
class StereoImages:
    """Pairs of images, none of which is in memory before it is asked for.

    Attributes
    ----------
    name : str
        What to call the drive.
    rig : StereoRig
        Both cameras as they took the images.
    stamps : ndarray of int64, (T,)
        Nanoseconds, strictly increasing; numbers of the frames where they are not ``timed``.
    places : sequence of int, (T,)
        Of the pairs, for ``reader``.
    reader : callable
        Reads the pairs.
    timed : bool
        Whether the source tells when the images were taken.
    motion : Motion or None
    unsettled : Conventions or None
        How to find from the images what the twists mean, where nothing has told it yet.
    turns : Motion or None
        What the gyroscope measured, where that is not the motion itself: for the tracker.
    ground_truth : Trajectory or None
        Poses of the body in its first pose's frame, where they are known.
    notes : tuple of str
        What was taken for what, repaired or left out, a sentence each.
    is_of_graph : bool
        Whether a bag holds them under the names of the live graph, so that the nodes can be sent
        what it holds as it stands.
    """

    name: str
    rig: StereoRig
    stamps: NDArray[np.int64]
    places: Sequence[int]
    reader: PairReader
    timed: bool = True
    motion: Motion | None = None
    unsettled: Conventions | None = None
    turns: Motion | None = None
    ground_truth: Trajectory | None = None
    notes: tuple[str, ...] = ()
    is_of_graph: bool = False

    def __len__(self) -> int:
        return len(self.stamps)

    def known_motion(self) -> Motion:
        """Motion in the time of the images.

        Raises
        ------
        VislamError
            Where nothing tells it, or the times of the images, or these are not its times, or are
            no times of images.
        """
        if self.motion is None or not self.timed:
            what = "the motion" if self.motion is None else "the times of the images"
            # A reader may have refused all of it.
            skipped = "".join(f" ({note.rstrip('.')})" for note in self.notes if "Skipped" in note)
            raise VislamError(
                f"{self.name}: nothing tells {what}: give a dataset or a bag that does with "
                f"--motion{skipped}"
            )
        if len(self) > 1:
            period = float(np.median(np.diff(self.stamps))) / NANOSECONDS
            PERIOD.require(period, f"{self.name}: unit of the stamps")
        (begin, end), (first, last) = self.motion.stamps[[0, -1]], self.stamps[[0, -1]]
        if begin > last or end < first:
            raise VislamError(
                f"{self.name}: its images are from {first} to {last} ns and its motion from "
                f"{begin} to {end} ns: both must tell the time by one clock, in nanoseconds"
            )
        return self.motion.during(self.stamps)

    def pairs(self) -> Iterator[StereoPair]:
        """Read the pairs, in the order of their stamps.

        Raises
        ------
        VislamError
            Naming the image that cannot be read.
        """
        for stamp, (left, right) in zip(
            self.stamps.tolist(), self.reader(self.places), strict=True
        ):
            yield StereoPair(stamp, left, right)

    def at(self, rows: NDArray[np.intp], stamps: NDArray[np.int64]) -> "StereoImages":
        """Some of the pairs, by their rows (n,), increasing, with other stamps (n,)."""
        places = [self.places[row] for row in rows.tolist()]
        return replace(self, stamps=stamps, places=places, timed=True)
