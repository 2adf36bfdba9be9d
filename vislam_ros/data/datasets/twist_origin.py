# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which point of a vehicle a file's twists are those of, measured in its images.

KITTI's drives circulate with an ``imu_T_cam`` whose rotation R is right, and whose translation is
``t = R^T s``, made of that of ``cam_T_imu``, s, where ``-R s`` belongs. The body such a file
describes is none of the vehicle's sensors: the camera's place in it is wrong, and references made
with the same matrix are its. The twists are still the IMU's, which stands in that body at ::

    r = t + R R t

2.6 m away on KITTI, so they are off by ``omega x r``, 1.4 m/s where the car turns by 0.5 rad/s.
Between two frames the images tell the twist of the body itself; what the measured one has more, in
turns, tells r.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.left_image import left_warp
from vislam_ros.core.noise.twist_noise import white_noise_levels
from vislam_ros.data.datasets.step_pairs import step_pairs
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

# The steps that turn the most are looked at: they tell the most.
_STEPS_LOOKED_AT, _FEWEST_STEPS = 600, 20
# A place that differs less does not matter, metres.
_SMALLEST_DISTANCE = 0.3
# D is the squared Mahalanobis distance from the body's origin to the IMU. The measured place must
# lie nearer to the IMU's by at least the evidence, in such squares. If it is the origin's, the
# difference is normal with mean -D and variance 4 D. From 25 on, it is this large once in three
# thousand drives; once in a hundred if the covariance is half of what it should be.
_TELLING, _EVIDENCE = 25.0, 9.0
# White noise of a pixel; from so many standard deviations a residual counts less, and from so many
# not at all.
_PIXEL_VARIANCE, _HUBER, _OUTLIER = 1.0, 3.0, 12.0
# Twist noise is at least so much, m/s and rad/s.
_LEAST_NOISE = (1e-3, 1e-4)
_ROUNDS, _ITERATIONS = 2, 3
# What may be off by how much: place [m], velocity [m/s], angular velocity [rad/s].
_PRIOR_STD = np.repeat([10.0, 1.0, 0.05], 3)


class TwistOrigin(NamedTuple):
    """Place (3,) in the body of the point whose twist is measured, and its covariance (3, 3)."""

    place: Array
    covariance: Array

    def distance_squared(self, place: Array) -> float:
        """Squared Mahalanobis distance to a place (3,)."""
        error = self.place - place
        return float(error @ np.linalg.solve(self.covariance, error))


class _Steps(NamedTuple):
    """What the images of K steps say of their motions, ``e = G xi`` with noise C, by n points."""

    e: Array  # (n, 2)
    G: Array  # (n, 2, 6)
    information: Array  # (n, 2, 2)
    first: NDArray[np.int64]  # (K,), of the points of each step
    tau: Array  # (K,)
    angular_velocity: Array  # (K, 3)

    def of_points(self, values: Array) -> Array:
        """Values (K, ...) of steps as those of their points (n, ...)."""
        return np.repeat(values, np.diff(self.first, append=len(self.e)), axis=0)


def misplaced_imu(camera: StereoCamera) -> Array:
    """Place (3,) of the IMU if the extrinsics' translation was turned the wrong way, metres."""
    R, t = camera.T_body_camera[:3, :3], camera.T_body_camera[:3, 3]
    return np.asarray(t + R @ R @ t)


def moved_to_the_body(drive: Drive, imu: Array) -> Array:
    """Twists (N, 6) of the body's origin, from those of an IMU at a place (3,) in it."""
    v, omega = drive.twists[:, :3], drive.twists[:, 3:]
    return np.column_stack([v - np.cross(omega, imu), omega])


def is_nearer(measured: TwistOrigin, imu: Array) -> bool:
    """Whether the twists are an IMU's at a place (3,) beyond doubt, not those of the origin."""
    telling = float(imu @ np.linalg.solve(measured.covariance, imu))
    evidence = measured.distance_squared(np.zeros(3)) - measured.distance_squared(imu)
    return bool(
        np.linalg.norm(imu) > _SMALLEST_DISTANCE and telling > _TELLING and evidence > _EVIDENCE
    )


def measure_twist_origin(drive: Drive) -> TwistOrigin | None:
    """Find the place of the point that a drive's twists are those of; None for too few steps.

    In step k the measured twist is ``u + H x + n`` with ``H x = [omega x r + c; b]``: place r,
    constant errors of velocity and angular velocity. The images tell u, so ``x`` is found by
    generalised least squares, the motion of each step marginalised, outliers losing their weight.
    Steps count as independent, though neighbours share a frame's pixels: on clean drives the
    covariance is up to three times too small.
    """
    steps, prior = _steps(drive), np.diag(_PRIOR_STD**-2.0)
    if steps is None:
        return None
    levels = np.maximum(white_noise_levels(drive.twists), _LEAST_NOISE)
    precision = np.repeat(levels, 3) ** -2.0
    tau = steps.tau[:, None]
    of_twist = np.eye(6) * (precision / tau**2)[:, None]
    x = np.zeros(9)
    for _ in range(_ROUNDS):
        expected = -tau * (_by_unknowns(steps.angular_velocity - x[6:]) @ x)
        xi = expected
        for _ in range(_ITERATIONS):
            A, b = _information(steps, xi)
            M = np.asarray(np.linalg.inv(A + of_twist), dtype=np.float64)
            xi = _times(M, b + _times(of_twist, expected))
        H = tau[..., None] * _by_unknowns(steps.angular_velocity + xi[:, 3:] / tau)
        H_T = np.swapaxes(H, 1, 2)
        normal = prior + np.sum(H_T @ (A - A @ M @ A) @ H, axis=0)
        right = -np.sum(_times(H_T, b - _times(A @ M, b)), axis=0)
        x = np.asarray(np.linalg.solve(normal, right), dtype=float)
    return TwistOrigin(x[:3], np.asarray(np.linalg.inv(normal)[:3, :3], dtype=float))


def _steps(drive: Drive) -> _Steps | None:
    """What the images say of those steps that turn the most; None of too few."""
    turning = np.linalg.norm(drive.twists[1:, 3:], axis=1)
    most = np.argsort(-turning, kind="stable")[:_STEPS_LOOKED_AT]
    pairs = step_pairs(drive, np.sort(most))
    taken = np.unique(pairs.steps)
    if len(taken) < _FEWEST_STEPS:
        return None
    tau = np.diff(drive.twist_stamps)[taken] / NANOSECONDS
    twists = drive.twists[taken + 1]
    step_of = np.searchsorted(taken, pairs.steps)
    warped = left_warp(drive.camera, pairs.y, se3.exp(tau[:, None] * twists)[step_of])
    # v is the mean of two pixels.
    first = warped.F_y * (_PIXEL_VARIANCE * np.array([1.0, 1.0, 0.5]))
    noise = first @ np.swapaxes(warped.F_y, 1, 2) + _PIXEL_VARIANCE * np.eye(2)
    return _Steps(
        # What has passed the cameras says nothing.
        e=np.where(warped.ahead[:, None], pairs.left - warped.y, 0.0),
        G=np.where(warped.ahead[:, None, None], warped.G, 0.0),
        information=np.asarray(np.linalg.inv(noise), dtype=np.float64),
        first=np.searchsorted(step_of, np.arange(len(taken))),
        tau=tau,
        angular_velocity=twists[:, 3:],
    )


def _information(steps: _Steps, xi: Array) -> tuple[Array, Array]:
    """Information ``A`` (K, 6, 6) and ``b`` (K, 6) of images on motions, near ``xi`` (K, 6)."""
    residual = steps.e - _times(steps.G, steps.of_points(xi))
    squared = np.sum(residual * _times(steps.information, residual), axis=1)
    distance = np.sqrt(squared)
    weight = np.minimum(1.0, _HUBER / np.maximum(distance, _HUBER)) * (distance < _OUTLIER)
    weighted = weight[:, None, None] * steps.information @ steps.G
    weighted_T = np.swapaxes(weighted, 1, 2)
    A = np.add.reduceat(weighted_T @ steps.G, steps.first)
    return A, np.add.reduceat(_times(weighted_T, steps.e), steps.first)


def _times(matrices: Array, vectors: Array) -> Array:
    """Product (n, r) of matrices (n, r, c) with a vector each, (n, c)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _by_unknowns(omega: Array) -> Array:
    """H (K, 6, 9): the error of a twist by place, velocity's and angular velocity's error."""
    H = np.zeros((len(omega), 6, 9))
    H[:, :3, :3] = se3.hat(omega)
    H[:, :3, 3:6] = H[:, 3:, 6:] = np.eye(3)
    return H
