# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from scenes import STANDING, frame_of, passing_scene, pixels_of

from vislam_ros.core.filters.mapping import MappingFilter, MappingSettings
from vislam_ros.core.geometry.observation import StereoObservation

NO_GATES = {"chi2_gate": 0.0, "pixel_gate": 0.0}


@pytest.mark.parametrize("initialization", ["correlated", "independent"])
def test_it_is_the_dense_filter_of_the_reports_equations_43_to_47(initialization):
    settings = MappingSettings(landmark_initialization=initialization, **NO_GATES)
    scene = passing_scene(13)
    mapping = MappingFilter(settings, CAMERA)
    model = StereoObservation(CAMERA, settings.pixel_variance)
    T, mu, Sigma, order = np.eye(4), np.empty(0), np.empty((0, 0)), []
    for increment, frame in zip(scene.increments, scene.frames, strict=True):
        mapping.step(increment, frame)
        T = T @ increment.T
        seen = [i for i, key in enumerate(frame.keys) if key in order]
        H, r = np.zeros((3 * len(seen), len(mu))), np.zeros(3 * len(seen))
        for row, i in enumerate(seen):
            j = 3 * order.index(frame.keys[i])
            predicted = model.predict(T, mu[None, j : j + 3])
            H[3 * row : 3 * row + 3, j : j + 3] = predicted.H_landmark[0]
            r[3 * row : 3 * row + 3] = model.rows(frame.pixels[i : i + 1])[0] - predicted.z[0]
        K = Sigma @ H.T @ np.linalg.inv(H @ Sigma @ H.T + np.kron(np.eye(len(seen)), model.noise))
        mu, Sigma = mu + K @ r, (np.eye(len(mu)) - K @ H) @ Sigma
        for i, key in enumerate(frame.keys):
            if key not in order:
                position, _, noise = model.invert(T, frame.pixels[i : i + 1])
                prior = noise[0] if initialization == "correlated" else 0.5 * np.eye(3)
                order.append(key)
                mu = np.append(mu, position[0])
                n = len(Sigma)
                Sigma = np.block([[Sigma, np.zeros((n, 3))], [np.zeros((3, n)), prior]])
    keys, means, covariances = mapping.landmarks()
    assert sorted(keys) == sorted(order)
    for key, mean, covariance in zip(keys, means, covariances, strict=True):
        j = 3 * order.index(key)
        assert_allclose(mean, mu[j : j + 3], atol=1e-9)
        assert_allclose(covariance, Sigma[j : j + 3, j : j + 3], atol=1e-9)


def test_planar_landmarks_stay_on_the_ground_and_move_in_x_and_y():
    rng = np.random.default_rng(14)
    truth = np.column_stack([rng.uniform(8, 20, 10), rng.uniform(-4, 4, 10), np.zeros(10)])
    exact = pixels_of(np.eye(4), truth)
    mapping = MappingFilter(MappingSettings(planar=True, **NO_GATES), CAMERA)
    errors = []
    for _ in range(30):
        mapping.step(STANDING, frame_of(np.arange(10), exact + rng.standard_normal(exact.shape)))
        _, means, covariances = mapping.landmarks()
        errors.append(np.linalg.norm(means - truth))
        assert np.all(means[:, 2] == 0)
        assert np.all(covariances[:, 2] == 0)
    assert errors[-1] < 0.5 * errors[0]


def test_map_errors_fit_their_covariances():
    rng = np.random.default_rng(15)
    truth = np.column_stack(
        [rng.uniform(5, 12, 300), rng.uniform(-3, 3, 300), rng.uniform(-1, 1, 300)]
    )
    exact = pixels_of(np.eye(4), truth)
    mapping = MappingFilter(MappingSettings(**NO_GATES), CAMERA)
    for _ in range(20):
        mapping.step(STANDING, frame_of(np.arange(300), exact + rng.standard_normal(exact.shape)))
    _, means, covariances = mapping.landmarks()
    errors = means - truth
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    assert nees.mean() / 3 == pytest.approx(1, abs=0.15)
