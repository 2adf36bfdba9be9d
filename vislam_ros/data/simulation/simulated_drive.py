# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive and the truth about it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.drive import Drive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedLandmarks:
    """The physical points behind the tracks, by (id, generation).

    Attributes
    ----------
    ids : ndarray of uint32, (P,)
    generations : ndarray of uint32, (P,)
        Counts the points that an id stands for, from 0.
    positions : ndarray, (P, 3)
        World, metres; of a sliding one where it was first seen.
    sliding : ndarray of bool, (P,)
    """

    ids: NDArray[np.uint32]
    generations: NDArray[np.uint32]
    positions: Array
    sliding: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"<SimulatedLandmarks: {len(self.ids)}, {int(self.sliding.sum())} sliding>"


@dataclass(frozen=True)
class SimulatedDrive:
    """A drive and the truth about it.

    Attributes
    ----------
    drive : Drive
        What :func:`vislam_ros.data.datasets.npz.read` reads from the written file.
    seconds : ndarray, (T,)
        Time stamps as a dataset holds them, UNIX seconds.
    T_world_body : ndarray, (T, 4, 4)
        True poses.
    true_twists : ndarray, (T, 6)
        Twists without noise and bias.
    frozen : ndarray of bool, (T,)
        Steps at which old tracks repeat their pixels.
    landmarks : SimulatedLandmarks
    """

    drive: Drive
    seconds: Array
    T_world_body: Array
    true_twists: Array
    frozen: NDArray[np.bool_]
    landmarks: SimulatedLandmarks

    def __repr__(self) -> str:
        return f"<SimulatedDrive: {self.drive!r}, {int(self.frozen.sum())} frozen steps>"
