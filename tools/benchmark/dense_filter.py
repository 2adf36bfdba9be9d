# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint filter over all landmarks at once, in plain numpy: what the active set saves.

It is kinder to itself than a filter that follows the report to the letter: the motion touches the
pose's rows alone, H is never written out, and the update is one product.
"""

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from benchmark.interleaving import cpu_clock
from benchmark.steady_session import CAMERA
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import pixels_of
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.motion import Increment

Array = NDArray[np.float64]


class DenseFilter:
    """EKF over ``[xi; delta m_1; ...; delta m_M]``, of which some landmarks are seen each step.

    Parameters
    ----------
    landmarks : int
        M.
    seen : int
        How many of them each step sees.
    """

    def __init__(self, landmarks: int, seen: int):
        rng = np.random.default_rng(0)
        size = 6 + 3 * landmarks
        root = 0.01 * rng.standard_normal((size, 12))
        self._P: Array = root @ root.T
        self._P[np.diag_indices(size)] += 0.01
        disparity = rng.uniform(4.0, 60.0, landmarks)
        u, v = rng.uniform(100.0, 1140.0, landmarks), rng.uniform(100.0, 275.0, landmarks)
        y = np.column_stack([u, u - disparity, v])
        T = CAMERA.T_body_camera
        self._means: Array = CAMERA.triangulate(y) @ T[:3, :3].T + T[:3, 3]
        self._pixels = pixels_of(y)
        self._observation = StereoObservation(CAMERA, (1.0, 1.0, 1.0, 1.0))
        self._T_world_body = np.eye(4)
        self._increment = Increment(np.eye(4), 0.1, 1e-6 * np.eye(6))
        self._slots = rng.choice(landmarks, seen, replace=False)

    def __call__(self) -> float:
        """Take a step; return the seconds it took."""
        begin = cpu_clock()
        self._predict(self._increment)
        self._correct(self._slots, self._pixels[self._slots])
        return cpu_clock() - begin

    def _predict(self, increment: Increment) -> None:
        F, P = increment.transition, self._P
        self._T_world_body = self._T_world_body @ increment.T
        P[:6] = F @ P[:6]
        P[:, :6] = P[:, :6] @ F.T
        P[:6, :6] += increment.covariance

    def _correct(self, slots: NDArray[np.int64], pixels: Array) -> None:
        P = self._P
        predicted = self._observation.predict(self._T_world_body, self._means[slots])
        residual = self._observation.rows(pixels) - predicted.z
        n, r = residual.shape
        rows = (6 + 3 * slots[:, None] + np.arange(3)).ravel()
        HP = (predicted.H_pose @ P[:6] + predicted.H_landmark @ P[rows].reshape(n, 3, -1)).reshape(
            n * r, -1
        )
        S = HP[:, :6] @ predicted.H_pose.reshape(n * r, 6).T
        columns = HP[:, rows].reshape(n * r, n, 3)
        S += np.einsum("ajc,jsc->ajs", columns, predicted.H_landmark).reshape(n * r, n * r)
        S += np.kron(np.eye(n), self._observation.noise)
        L = np.linalg.cholesky(S)
        Y = scipy.linalg.solve_triangular(L, HP, lower=True)
        whitened = scipy.linalg.solve_triangular(L, residual.ravel(), lower=True)
        P -= Y.T @ Y
        delta = whitened @ Y
        self._T_world_body = self._T_world_body @ se3.exp(delta[:6])
        self._means = self._means + delta[6:].reshape(-1, 3)
