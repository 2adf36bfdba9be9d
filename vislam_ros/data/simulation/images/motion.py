# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Smooth motion through poses, so that an IMU can be read at any time of it."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from vislam_ros.core.geometry import se3
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


class SmoothMotion:
    """The motion through given poses whose acceleration and angular acceleration are continuous.

    Positions by cubic splines, attitudes by scipy's RotationSpline.

    Parameters
    ----------
    stamps : ndarray of int64, (n,)
        At least two, nanoseconds.
    T_world_body : ndarray, (n, 4, 4)
    """

    def __init__(self, stamps: Stamps, T_world_body: Array) -> None:
        self.first, self.last = int(stamps[0]), int(stamps[-1])
        seconds = self._seconds(stamps)
        self._position = CubicSpline(seconds, T_world_body[:, :3, 3])
        self._attitude = RotationSpline(seconds, Rotation.from_matrix(T_world_body[:, :3, :3]))

    def poses(self, stamps: Stamps) -> Array:
        """Poses ``T_world_body`` (m, 4, 4) at times between the first and the last."""
        seconds = self._seconds(stamps)
        T = np.tile(np.eye(4), (len(stamps), 1, 1))
        T[:, :3, :3] = self._attitude(seconds).as_matrix()
        T[:, :3, 3] = self._position(seconds)
        return T

    def velocities(self, stamps: Stamps) -> Array:
        """Velocities (m, 3) in the world, metres a second."""
        return np.asarray(self._position(self._seconds(stamps), 1))

    def _seconds(self, stamps: Stamps) -> Array:
        return (stamps - self.first) / NANOSECONDS


def room_poses(seconds: Array, rng: np.random.Generator) -> Array:
    """Poses ``T_world_body`` (n, 4, 4) of a drone that looks around in a room.

    It flies about a metre to all sides of the origin, slowly turns, rolls and nods.

    Parameters
    ----------
    seconds : ndarray, (n,)
    rng : Generator
        Draws the phases.
    """
    phase = rng.uniform(0, 2 * np.pi, 8)

    def wave(size: float, period: float, k: int) -> Array:
        return size * np.sin(2 * np.pi * seconds / period + phase[k])

    T = np.tile(np.eye(4), (len(seconds), 1, 1))
    yaw = 2 * np.pi * seconds / 26 + wave(0.5, 6.1, 0) - wave(0.5, 6.1, 0)[0]
    pitch = 0.08 + wave(0.12, 3.7, 1) + wave(0.02, 0.9, 2)
    roll = wave(0.12, 4.3, 3) + wave(0.02, 1.1, 4)
    zero = np.zeros(len(seconds))
    T[:, :3, :3] = (
        se3.exp_rotation(np.column_stack([zero, zero, yaw]))
        @ se3.exp_rotation(np.column_stack([zero, pitch, zero]))
        @ se3.exp_rotation(np.column_stack([roll, zero, zero]))
    )
    T[:, 0, 3] = wave(1.3, 9.7, 5)
    T[:, 1, 3] = wave(1.1, 7.3, 6)
    T[:, 2, 3] = wave(0.35, 5.3, 7)
    return T
