# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from scenes import passing_scene

from vislam_ros.core.filters.block_diagonal import BlockDiagonalFilter, BlockDiagonalSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.observation import StereoObservation

NO_GATES = {"chi2_gate": 0.0, "pixel_gate": 0.0}


class DenseBlockDiagonal:
    """The joint filter over everything, written out, whose C is set to 0 after each update."""

    def __init__(self, settings):
        self.settings = settings
        self.model = StereoObservation(CAMERA, settings.pixel_variance)
        self.T, self.P = np.eye(4), np.zeros((6, 6))
        self.means = {}

    def step(self, increment, frame):
        keys = list(self.means)
        self.T = self.T @ increment.T
        self.P[:6, :6] = (
            increment.transition @ self.P[:6, :6] @ increment.transition.T + increment.covariance
        )
        seen = [(k, z) for k, z in zip(frame.keys, frame.pixels, strict=True) if k in self.means]
        if seen:
            self._correct(keys, seen)
        for key, pixels in zip(frame.keys, frame.pixels, strict=True):
            if key not in self.means:
                self._initialize(key, pixels)

    def _correct(self, keys, seen):
        H = np.zeros((3 * len(seen), len(self.P)))
        r = np.zeros(3 * len(seen))
        for i, (key, pixels) in enumerate(seen):
            predicted = self.model.predict(self.T, self.means[key][None])
            rows, slot = slice(3 * i, 3 * i + 3), 6 + 3 * keys.index(key)
            H[rows, :6] = predicted.H_pose[0]
            H[rows, slot : slot + 3] = predicted.H_landmark[0]
            r[rows] = self.model.rows(pixels[None])[0] - predicted.z[0]
        S = H @ self.P @ H.T + np.kron(np.eye(len(seen)), self.model.noise)
        K = self.P @ H.T @ np.linalg.inv(S)
        delta = K @ r
        P = (np.eye(len(self.P)) - K @ H) @ self.P
        self.T = self.T @ se3.exp(delta[:6])
        self.P = np.zeros_like(P)
        self.P[:6, :6] = P[:6, :6]
        for j, key in enumerate(keys):
            block = slice(6 + 3 * j, 9 + 3 * j)
            self.P[block, block] = P[block, block]
            self.means[key] = self.means[key] + delta[block]

    def _initialize(self, key, pixels):
        position, J, noise = (a[0] for a in self.model.invert(self.T, pixels[None]))
        if self.settings.landmark_initialization == "correlated":
            covariance = J @ self.P[:6, :6] @ J.T + noise
        else:
            covariance = self.settings.landmark_prior_variance * np.eye(3)
        n = len(self.P)
        self.P = np.block([[self.P, np.zeros((n, 3))], [np.zeros((3, n)), covariance]])
        self.means[key] = position


@pytest.mark.parametrize("initialization", ["correlated", "independent"])
def test_it_is_the_dense_filter_with_its_cross_covariance_set_to_zero(initialization):
    settings = BlockDiagonalSettings(landmark_initialization=initialization, **NO_GATES)
    scene = passing_scene(11)
    fast, dense = BlockDiagonalFilter(settings, CAMERA), DenseBlockDiagonal(settings)
    for increment, frame in zip(scene.increments, scene.frames, strict=True):
        outcome = fast.step(increment, frame)
        dense.step(increment, frame)
        assert_allclose(fast.T_world_body, dense.T, atol=1e-9)
        assert_allclose(fast.pose_covariance, dense.P[:6, :6], atol=1e-12)
    assert outcome.used > 0
    keys, means, covariances = fast.landmarks()
    assert len(keys) == len(dense.means) == len(scene.landmarks)
    for key, mean, covariance in zip(keys, means, covariances, strict=True):
        slot = 6 + 3 * list(dense.means).index(key)
        assert_allclose(mean, dense.means[key], atol=1e-9)
        assert_allclose(covariance, dense.P[slot : slot + 3, slot : slot + 3], atol=1e-9)


def test_it_corrects_the_drift_of_the_prediction():
    scene = passing_scene(12, steps=60)
    slam = BlockDiagonalFilter(BlockDiagonalSettings(), CAMERA)
    T = np.eye(4)
    for increment, frame in zip(scene.increments, scene.frames, strict=True):
        slam.step(increment, frame)
        T = T @ increment.T
    truth = scene.T_world_body[-1]
    drift = np.linalg.norm(se3.log(se3.inverse(truth) @ T))
    assert np.linalg.norm(se3.log(se3.inverse(truth) @ slam.T_world_body)) < 0.5 * drift
