# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimation problem that peers are given: the very tracks and motions of our filter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.recorded_drive import RecordedDrive
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PeerProblem:
    """Motions and observations of T steps.

    Attributes
    ----------
    camera : StereoCamera
    durations : ndarray, (T,)
        Seconds of each step; 0 of the first.
    motions : ndarray, (T, 6)
        ``[rho; theta]`` of each step by the twist; 0 of the first.
    twist_std : ndarray, (6,)
        White noise of a twist, m/s and rad/s.
    pixel_std : ndarray, (3,)
        Noise of ``u_left, u_right, v``, pixels.
    observations : tuple of (ndarray of int64 (n,), ndarray (n, 3))
        For each step, the physical points and their ``u_left, u_right, v``. Tracks are begun
        anew where our filter began them anew, and what its gate rejected is left out.
    """

    camera: StereoCamera
    durations: Array
    motions: Array
    twist_std: Array
    pixel_std: Array
    observations: tuple[tuple[NDArray[np.int64], Array], ...]

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return len(self.observations)

    def motion(self, k: int, gyro_bias: Array | None) -> Array:
        """Motion (6,) of step k by the twist, less a bias (3,) of its angular velocity."""
        if gyro_bias is None:
            return self.motions[k]
        rho, theta = self.motions[k, :3], self.motions[k, 3:]
        return np.concatenate([rho, theta - self.durations[k] * gyro_bias])

    def triangulate(self, T_world_body: Array, points: Array) -> Array:
        """World positions (n, 3) of ``u_left, u_right, v`` (n, 3) with positive disparity."""
        T = T_world_body @ self.camera.T_body_camera
        return np.asarray(self.camera.triangulate(points) @ T[:3, :3].T + T[:3, 3])


def peer_problem(
    recorded: RecordedDrive,
    camera: StereoCamera,
    *,
    twist_noise: tuple[float, float],
    pixel_std: float,
) -> PeerProblem:
    """Make a problem of what a filter had.

    Parameters
    ----------
    recorded : RecordedDrive
    camera : StereoCamera
    twist_noise : tuple of float
        Of velocity and angular velocity, m/s and rad/s.
    pixel_std : float
        Of each of the four pixel coordinates; v, the mean of two, has less.
    """
    observations = []
    for filter_step in recorded.filter_steps:
        frame = filter_step.frame
        kept = ~np.isin(frame.keys, filter_step.outcome.rejected)
        u_left, v_left, u_right, v_right = frame.pixels[kept].T
        points = np.column_stack([u_left, u_right, (v_left + v_right) / 2])
        observations.append((frame.keys[kept], points))
    increments = [filter_step.increment for filter_step in recorded.filter_steps]
    return PeerProblem(
        camera=camera,
        durations=np.array([increment.duration for increment in increments]),
        motions=se3.log(np.array([increment.T for increment in increments])),
        twist_std=np.repeat(twist_noise, 3),
        pixel_std=pixel_std * np.array([1.0, 1.0, np.sqrt(0.5)]),
        observations=tuple(observations),
    )
