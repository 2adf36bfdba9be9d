# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive in memory: all that the graph hears, from whatever file it came."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.tracking.refusals import RefusalCounts
from vislam_ros.data.trajectory import Trajectory


@dataclass(frozen=True)
class Drive:
    """Stereo feature tracks and body twists, held sparsely.

    A drive read from a dataset and the same drive read back from its bag are equal field for
    field, so whatever is computed from either is equal too.

    Attributes
    ----------
    name : str
        What to call it, such as the file's stem.
    camera : StereoCamera
    image_size : tuple of int, (2,)
        Width and height, pixels; the smallest that holds every feature where it is not known.
    twist_stamps : ndarray of int64, (N,)
        Nanoseconds, strictly increasing.
    twists : ndarray, (N, 6)
        ``[v; omega]`` in the body frame, metres and radians a second. The twist with stamp
        ``t[k+1]`` is the one that holds over the step from ``t[k]`` to ``t[k+1]``.
    feature_stamps : ndarray of int64, (T,)
        Nanoseconds, strictly increasing.
    offsets : ndarray of int64, (T + 1,)
        Frame ``k`` is made of the rows ``offsets[k]:offsets[k + 1]`` of the next two.
    ids : ndarray of uint32, (n,)
        Track of each observation, increasing inside a frame.
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    ground_truth : Trajectory or None
        Poses of the body in its first pose's frame, where they are known.
    notes : tuple of str
        What a reader repaired or left out, a sentence each.
    refused : RefusalCounts
        Messages that a reader refused, as the nodes would.
    """

    name: str
    camera: StereoCamera
    image_size: tuple[int, int]
    twist_stamps: NDArray[np.int64]
    twists: NDArray[np.float64]
    feature_stamps: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]
    ground_truth: Trajectory | None = None
    notes: tuple[str, ...] = ()
    refused: RefusalCounts = field(default_factory=RefusalCounts)

    @property
    def steps(self) -> int:
        """Number of feature frames."""
        return len(self.feature_stamps)

    @property
    def tracks(self) -> int:
        """Number of different ids."""
        return len(np.unique(self.ids))

    @property
    def duration(self) -> float:
        """Seconds from the first feature frame to the last."""
        if not self.steps:
            return 0.0
        return float(self.feature_stamps[-1] - self.feature_stamps[0]) * 1e-9

    def frame(self, k: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        """Ids (n,) and pixels (n, 4) of frame ``k``."""
        rows = slice(self.offsets[k], self.offsets[k + 1])
        return self.ids[rows], self.pixels[rows]
