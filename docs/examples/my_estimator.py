# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An estimator of your own, in a file of your own: stereo odometry from frame to frame.

    python my_estimator.py                                          a simulated drive
    vislam solve DRIVE --estimator my_estimator:MyEstimator --out results

It holds no map. Points are triangulated from the last frame, and where this frame sees them
corrects the motion between the two, as an EKF does whose only state is that motion.
"""

from dataclasses import dataclass

import numpy as np

import vislam_ros as vi
from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.registry import Surroundings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.motion import Increment, propagate
from vislam_ros.core.settings import setting
from vislam_ros.core.tracking.tracked_frame import TrackedFrame


@dataclass(frozen=True)
class MySettings(vi.SlamSettings):
    """What can be set, by ``vi.solve(drive, MySettings(pixel_std=2))`` or in a parameter file."""

    estimator: str = "my_estimator"
    pixel_std: float = setting(1.0, "Noise of each of the four pixels [px]", minimum=0.01)
    gate: float = setting(16.27, "Bound of an innovation's squared Mahalanobis distance")


class MyEstimator:
    """What every estimator has: a pose with its covariance, a step, and a map, empty here."""

    active = 0
    landmark_count = 0

    def __init__(self, settings: MySettings, given: Surroundings):
        self._gate = settings.gate
        self._observation = StereoObservation(given.camera, (settings.pixel_std**2,) * 4)
        self._last: TrackedFrame | None = None
        self.T_world_body = np.eye(4)
        self.pose_covariance = settings.prior_pose_variance * np.eye(6)

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Move as the twist says, then correct that motion by what both frames see."""
        T_last = self.T_world_body
        self.T_world_body = T_last @ increment.T
        W, outcome = increment.covariance, Outcome()
        if self._last is not None:
            W, outcome = self._correct(W, T_last, self._last, frame)
        motion = Increment(se3.inverse(T_last) @ self.T_world_body, increment.duration, W)
        self.pose_covariance = propagate(self.pose_covariance, motion)
        self._last = frame
        return outcome

    def _correct(
        self, W: np.ndarray, T_last: np.ndarray, last: TrackedFrame, frame: TrackedFrame
    ) -> tuple[np.ndarray, Outcome]:
        """Correct the pose; return the covariance of the motion, W before, and what was used."""
        # A key is a point: the two frames' common keys are the points that both see.
        keys, was, now = np.intersect1d(last.keys, frame.keys, return_indices=True)
        near = last.pixels[was, 0] - last.pixels[was, 2] > 1.0
        keys, was, now = keys[near], was[near], now[near]
        points, _, P = self._observation.invert(T_last, last.pixels[was])

        # One innovation of three rows for each point: z - h(x), its H, and its noise.
        predicted = self._observation.predict(self.T_world_body, points)
        residual = self._observation.rows(frame.pixels[now]) - predicted.z
        H, H_point = predicted.H_pose, predicted.H_landmark
        R = H_point @ P @ H_point.transpose(0, 2, 1) + self._observation.noise
        S = H @ W @ H.transpose(0, 2, 1) + R
        good = predicted.visible & passes_gates(residual, S, self._gate, 0.0)
        residual, H, R = residual[good], H[good], R[good]

        # The update in its information form, for points have nothing in common but the motion:
        # W+ = (W^-1 + sum H^T R^-1 H)^-1, xi = W+ sum H^T R^-1 r, T+ = T Exp(xi).
        weighted = H.transpose(0, 2, 1) @ np.linalg.inv(R)
        information = (weighted @ H).sum(axis=0)
        W_plus = np.linalg.solve(np.eye(6) + W @ information, W)
        xi = W_plus @ (weighted @ residual[..., None]).sum(axis=0)[:, 0]
        self.T_world_body = self.T_world_body @ se3.exp(xi)
        return W_plus, Outcome(used=len(residual), rejected=keys[~good])

    def landmarks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Keys (M,), positions (M, 3) and covariances (M, 3, 3) of the map."""
        return np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3, 3))


vi.register_estimator("my_estimator", MySettings, MyEstimator)


if __name__ == "__main__":
    drive = vi.simulate(steps=200, landmarks=1000).drive
    noise = {"velocity_noise_std": 0.1, "angular_velocity_noise_std": 0.01}  # of its twists
    for name in ("dead_reckoning", "my_estimator", "robocentric"):
        solution = vi.solve(drive, estimator=name, **noise)
        ate = vi.evaluate(solution.trajectory, drive.ground_truth).ate.rmse
        print(f"{name}: ATE {ate:.2f} m")
