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
from vislam_ros.core.geometry.warp import warp
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
_LEFT = np.array([0, 2])


class TwistOrigin(NamedTuple):
    """Place (3,) in the body of the point whose twist is measured, and its covariance (3, 3)."""

    place: Array
    covariance: Array

    def distance_squared(self, place: Array) -> float:
        """Squared Mahalanobis distance to a place (3,)."""
        error = self.place - place
        return float(error @ np.linalg.solve(self.covariance, error))


class _Step(NamedTuple):
    """What the images of a step say of its motion, ``e = G xi`` with noise C."""

    e: Array  # (n, 2)
    G: Array  # (n, 2, 6)
    information: Array  # (n, 2, 2)
    tau: float
    angular_velocity: Array  # (3,)


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
    if len(steps) < _FEWEST_STEPS:
        return None
    levels = np.maximum(white_noise_levels(drive.twists), _LEAST_NOISE)
    precision = np.repeat(levels, 3) ** -2.0
    x = np.zeros(9)
    for _ in range(_ROUNDS):
        normal, right = prior.copy(), np.zeros(9)
        for step in steps:
            expected = -step.tau * (_by_unknowns(step.angular_velocity - x[6:]) @ x)
            xi = expected
            of_twist = np.diag(precision / step.tau**2)
            for _ in range(_ITERATIONS):
                A, b = _information(step, xi)
                M = np.linalg.inv(A + of_twist)
                xi = M @ (b + of_twist @ expected)
            H = step.tau * _by_unknowns(step.angular_velocity + xi[3:] / step.tau)
            normal += H.T @ (A - A @ M @ A) @ H
            right -= H.T @ (b - A @ M @ b)
        x = np.asarray(np.linalg.solve(normal, right), dtype=float)
    return TwistOrigin(x[:3], np.asarray(np.linalg.inv(normal)[:3, :3], dtype=float))


def _steps(drive: Drive) -> list[_Step]:
    camera = drive.camera
    turning = np.linalg.norm(drive.twists[1:, 3:], axis=1)
    most = np.argsort(-turning, kind="stable")[:_STEPS_LOOKED_AT]
    pairs = step_pairs(drive, np.sort(most))
    tau = np.diff(drive.twist_stamps) / NANOSECONDS
    steps = []
    for k in np.unique(pairs.steps).tolist():
        rows = pairs.steps == k
        warped = warp(camera, pairs.y[rows], se3.exp(tau[k] * drive.twists[k + 1]))
        ahead = warped.ahead
        F = warped.F_y[ahead][:, _LEFT]
        # v is the mean of two pixels.
        first = F * (_PIXEL_VARIANCE * np.array([1.0, 1.0, 0.5]))
        noise = first @ np.swapaxes(F, 1, 2) + _PIXEL_VARIANCE * np.eye(2)
        steps.append(
            _Step(
                e=pairs.left[rows][ahead] - warped.y[ahead][:, _LEFT],
                G=warped.G[ahead][:, _LEFT],
                information=np.asarray(np.linalg.inv(noise), dtype=np.float64),
                tau=float(tau[k]),
                angular_velocity=drive.twists[k + 1, 3:],
            )
        )
    return steps


def _information(step: _Step, xi: Array) -> tuple[Array, Array]:
    """Information ``A`` (6, 6) and ``b`` (6,) of a step's images on its motion, near ``xi``."""
    residual = step.e - step.G @ xi
    distance = np.sqrt(np.einsum("ni,nij,nj->n", residual, step.information, residual))
    weight = np.minimum(1.0, _HUBER / np.maximum(distance, _HUBER)) * (distance < _OUTLIER)
    weighted = weight[:, None, None] * step.information @ step.G
    A = np.einsum("nia,nib->ab", step.G, weighted)
    return A, np.einsum("nia,ni->a", weighted, step.e)


def _by_unknowns(omega: Array) -> Array:
    """H (6, 9): the error of a twist by place, velocity's error and angular velocity's error."""
    H = np.zeros((6, 9))
    H[:3, :3] = se3.hat(omega)
    H[:3, 3:6] = H[3:, 6:] = np.eye(3)
    return H
