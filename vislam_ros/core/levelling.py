# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How a body stands at its start: roll and pitch from the accelerometer, while it is at rest.

At rest an accelerometer measures the force that holds the body up, so the mean of its first half
second points upward (Titterton and Weston, Strapdown Inertial Navigation Technology, chapter 10).
Whether the body is at rest the samples themselves tell: the force is as strong as gravity, and
neither it nor the angular velocity changes from one part of that time to the next by more than
their noise. One that goes straight on at a steady speed measures the same, and its level is right
all the same.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity [m/s^2]; on Earth it differs by up to 0.04 from it."""

LEVEL_ERROR = np.radians(1.0)
"""What a level may be wrong by [rad]: a force that would tilt it further is no gravity, and what
turns so far in a second does not stand."""

LARGEST_GYRO_OFFSET = 0.1
"""Of a gyroscope at rest, by the data sheets of small sensors, 3 to 5 degrees/s [rad/s]."""

_PART_NS, _PARTS = 100_000_000, 5
# Standard errors by which means of the same may differ.
_STANDARD_ERRORS = 3.0


class Levelling:
    """Takes the first samples of an IMU, until they tell how the body stands, or that it moves.

    That is after half a second, and sooner where it moves, samples lie more than a tenth of a
    second apart, or one has no acceleration.

    Attributes
    ----------
    R_world_body : ndarray, (3, 3), or None
        Attitude of the body in a level world, with the yaw 0; None where it is not known.
    """

    def __init__(self) -> None:
        self.R_world_body: Array | None = None
        self._first: int | None = None
        self._parts: list[list[Array]] = []

    def add(self, stamp: int, omega: Array, acceleration: Array | None) -> bool:
        """Take a sample; tell whether no more is needed.

        Parameters
        ----------
        stamp : int
            Nanoseconds, later than all before.
        omega : ndarray, (3,)
            Angular velocity in the body's axes, rad/s.
        acceleration : ndarray, (3,), or None
            Specific force in the body's axes, m/s^2; None where it was not measured.
        """
        if acceleration is None:
            return True
        if self._first is None:
            self._first = stamp
        place = (stamp - self._first) // _PART_NS
        if place >= len(self._parts):
            if place > len(self._parts) or not _is_at_rest(self._parts):
                return True
            if place == _PARTS:
                mean = np.mean([sample for part in self._parts for sample in part], axis=0)
                self.R_world_body = level_attitude(mean[3:])
                return True
            self._parts.append([])
        self._parts[-1].append(np.concatenate([omega, acceleration]))
        return False


def level_attitude(upward: Array) -> Array:
    """Rotation (3, 3) from a body to a level world, with the yaw 0.

    Parameters
    ----------
    upward : ndarray, (3,)
        What points upward, in the body's axes; of any length but zero.
    """
    z = upward / np.linalg.norm(upward)
    cos_pitch = np.hypot(z[1], z[2])
    # Straight up or down the roll is the yaw: it is called 0.
    sin_roll, cos_roll = z[1:] / cos_pitch if cos_pitch else (0.0, 1.0)
    x = [cos_pitch, -z[0] * sin_roll, -z[0] * cos_roll]
    return np.array([x, [0.0, cos_roll, -sin_roll], z])


def _is_at_rest(parts: list[list[Array]]) -> bool:
    """Whether parts of samples (n, 6), angular velocity and force, are of one that stands."""
    if not parts:
        return True
    means = np.array([np.mean(part, axis=0) for part in parts])
    counts = np.array([len(part) for part in parts])
    mean = counts @ means / counts.sum()
    squares = sum(
        np.sum((np.array(part) - m) ** 2, axis=0) for part, m in zip(parts, means, strict=True)
    )
    freedom = max(int(counts.sum()) - len(parts), 1)
    noise = np.sqrt((squares / freedom).reshape(2, 3).sum(axis=1))  # of a sample: turn and force
    apart = np.linalg.norm((means - mean).reshape(-1, 2, 3), axis=2)
    limit = LEVEL_ERROR * np.array([1.0, GRAVITY])
    wrong = abs(np.linalg.norm(mean[3:]) - GRAVITY)
    return bool(
        np.all(apart <= limit + _STANDARD_ERRORS * noise / np.sqrt(counts)[:, None])
        and wrong <= limit[1] + _STANDARD_ERRORS * noise[1] / np.sqrt(counts.sum())
        and np.linalg.norm(mean[:3]) <= LARGEST_GYRO_OFFSET
    )
