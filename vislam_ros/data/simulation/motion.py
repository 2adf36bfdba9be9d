# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The way of a simulated car: turns, hills, a rough road, a varying speed and a stop."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]

_SUBSTEPS = 10  # of the integration, in each step
_CRUISE = 9.0  # metres a second
_BRAKING = 4.0  # seconds from cruise to standstill, and back
_SHORTEST_WITH_STOP = 20.0  # seconds
_STOP_SHARE = 0.05  # of the whole time
_STOP_AT = 0.55  # of the whole time

# Waves of the road that shake a car: cycles a metre, at 9 m/s one to four a second.
_LONGEST_WAVE, _SHORTEST_WAVE, _WAVES = 0.03, 0.3, 12
# How far they move it, so that its twist changes within a step as on KITTI: metres forward, to
# the left and up, radians about the same.
_SHAKE_STD = np.array([4e-3, 6e-3, 3.5e-3, 1.7e-3, 1.7e-3, 0.9e-3])


def drive_poses(steps: int, period: float, rng: np.random.Generator) -> Array:
    """Poses ``T_world_body`` (steps, 4, 4), the first of which is the identity.

    Everything but the speed is a function of the way gone, so a car that stands is still. A drive
    of less than twenty seconds has no stop.

    Parameters
    ----------
    steps : int
    period : float
        Seconds between poses.
    rng : Generator
        Draws the turns, the waves of the road, and the phases of speed, slope and roll.
    """
    dt = period / _SUBSTEPS
    t: Array = dt * np.arange((steps - 1) * _SUBSTEPS + 1, dtype=np.float64)
    speed = _speed(t, rng)
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * dt)])

    phases = rng.uniform(0, 2 * np.pi, 4)
    yaw = _yaw(way, rng)
    slope = 0.05 * np.sin(2 * np.pi * way / 210 + phases[0])
    pitch = -slope + 0.006 * np.sin(2 * np.pi * way / 23 + phases[1])
    roll = 0.02 * np.sin(2 * np.pi * way / 41 + phases[2])
    direction = np.column_stack(
        [np.cos(yaw) * np.cos(slope), np.sin(yaw) * np.cos(slope), np.sin(slope)]
    )
    velocity = speed[:, None] * direction
    position = np.concatenate(
        [np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * dt, axis=0)]
    )

    T = np.tile(np.eye(4), (steps, 1, 1))
    yaw, pitch, roll = yaw[::_SUBSTEPS], pitch[::_SUBSTEPS], roll[::_SUBSTEPS]
    zero = np.zeros(steps)
    T[:, :3, :3] = (
        se3.exp_rotation(np.column_stack([zero, zero, yaw]))
        @ se3.exp_rotation(np.column_stack([zero, pitch, zero]))
        @ se3.exp_rotation(np.column_stack([roll, zero, zero]))
    )
    T[:, :3, 3] = position[::_SUBSTEPS]
    return in_first_pose(T @ se3.exp(_shake(way[::_SUBSTEPS], rng)))


def in_first_pose(T_world_body: Array) -> Array:
    """Poses ``T_first_body`` (n, 4, 4) in the first one's frame; that itself is the identity."""
    T_first_body = se3.inverse(T_world_body[0]) @ T_world_body
    T_first_body[0] = np.eye(4)
    return T_first_body


def _speed(t: Array, rng: np.random.Generator) -> Array:
    phases = rng.uniform(0, 2 * np.pi, 2)
    cruise = _CRUISE * (
        1 + 0.25 * np.sin(2 * np.pi * t / 23 + phases[0]) + 0.1 * np.sin(t + phases[1])
    )
    duration = t[-1]
    if duration < _SHORTEST_WITH_STOP:
        return cruise
    from_stop = np.abs(t - _STOP_AT * duration) - _STOP_SHARE * duration / 2
    return cruise * _ramp(from_stop / _BRAKING)


def _yaw(way: Array, rng: np.random.Generator) -> Array:
    """Heading along a way: a weave, and turns of 40 to 90 degrees every hundred metres or so."""
    yaw = 0.03 * np.sin(2 * np.pi * way / 70 + rng.uniform(0, 2 * np.pi))
    start = rng.uniform(15, 30)
    while start < way[-1]:
        length = rng.uniform(45, 75)
        angle = np.radians(rng.uniform(40, 90)) * rng.choice([-1.0, 1.0])
        yaw += angle * _ramp((way - start) / length)
        start += length + rng.uniform(30, 90)
    return yaw


def _shake(way: Array, rng: np.random.Generator) -> Array:
    """Small motion ``xi`` (n, 6) that a rough road adds to a car."""
    wave = rng.uniform(_LONGEST_WAVE, _SHORTEST_WAVE, (_WAVES, 6))
    phase = rng.uniform(0, 2 * np.pi, (_WAVES, 6))
    waves = np.sin(2 * np.pi * wave * way[:, None, None] + phase)
    shake: Array = _SHAKE_STD * np.sqrt(2 / _WAVES) * waves.sum(axis=1)
    return shake


def _ramp(x: Array) -> Array:
    """Smooth step from 0 at x = 0 to 1 at x = 1."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0, 1))
