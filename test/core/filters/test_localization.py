# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA
from numpy.testing import assert_allclose
from scenes import passing_scene

from vislam_ros.core.filters.localization import LocalizationFilter, LocalizationSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.landmarks import LandmarkMap


def map_of(positions):
    n = len(positions)
    return LandmarkMap(
        np.arange(n, dtype=np.uint32),
        np.zeros(n, dtype=np.uint32),
        positions,
        np.zeros((n, 3, 3)),
    )


def ids_of_keys(keys):
    return keys.astype(np.uint32)


def test_it_is_the_plain_filter_of_the_reports_equations_55_to_61():
    settings = LocalizationSettings(chi2_gate=0.0)
    scene = passing_scene(16)
    model = StereoObservation(CAMERA, settings.pixel_variance)
    localization = LocalizationFilter(settings, CAMERA, map_of(scene.landmarks), ids_of_keys)
    T, Sigma = np.eye(4), np.zeros((6, 6))
    for increment, frame in zip(scene.increments, scene.frames, strict=True):
        outcome = localization.step(increment, frame)
        T = T @ increment.T
        Sigma = increment.transition @ Sigma @ increment.transition.T + increment.covariance
        predicted = model.predict(T, scene.landmarks[frame.keys])
        H = predicted.H_pose.reshape(-1, 6)
        r = (model.rows(frame.pixels) - predicted.z).ravel()
        S = H @ Sigma @ H.T + np.kron(np.eye(len(frame.keys)), model.noise)
        K = Sigma @ H.T @ np.linalg.inv(S)
        T, Sigma = T @ se3.exp(K @ r), (np.eye(6) - K @ H) @ Sigma
        assert_allclose(localization.T_world_body, T, atol=1e-9)
        assert_allclose(localization.pose_covariance, Sigma, atol=1e-12)
        assert outcome.nis == pytest.approx(r @ np.linalg.inv(S) @ r, rel=1e-6)


def test_pose_errors_fit_their_covariance():
    errors = []
    for seed in range(40):
        scene = passing_scene(seed, steps=12)
        localization = LocalizationFilter(
            LocalizationSettings(chi2_gate=0.0), CAMERA, map_of(scene.landmarks), ids_of_keys
        )
        for increment, frame in zip(scene.increments, scene.frames, strict=True):
            localization.step(increment, frame)
        xi = se3.log(se3.inverse(localization.T_world_body) @ scene.T_world_body[-1])
        errors.append(xi @ np.linalg.solve(localization.pose_covariance, xi))
    assert np.mean(errors) / 6 == pytest.approx(1, abs=0.3)


def test_an_id_with_several_landmarks_takes_the_one_that_fits():
    scene = passing_scene(17)
    n = len(scene.landmarks)
    both = LandmarkMap(
        np.tile(np.arange(n, dtype=np.uint32), 2),
        np.repeat(np.array([0, 1], dtype=np.uint32), n),
        np.concatenate([scene.landmarks + np.array([0.0, 30.0, 0.0]), scene.landmarks]),
        np.zeros((2 * n, 3, 3)),
    )
    one = LocalizationFilter(LocalizationSettings(), CAMERA, map_of(scene.landmarks), ids_of_keys)
    two = LocalizationFilter(LocalizationSettings(), CAMERA, both, ids_of_keys)
    for increment, frame in zip(scene.increments, scene.frames, strict=True):
        one.step(increment, frame)
        assert two.step(increment, frame).used > 0
        assert_allclose(two.T_world_body, one.T_world_body, atol=1e-12)


def test_landmarks_that_the_map_lacks_are_passed_over():
    scene = passing_scene(18)
    few = map_of(scene.landmarks[:5])
    localization = LocalizationFilter(LocalizationSettings(), CAMERA, few, ids_of_keys)
    outcomes = [
        localization.step(increment, frame)
        for increment, frame in zip(scene.increments, scene.frames, strict=True)
    ]
    assert outcomes[0].used > 0
    assert outcomes[-1].used == 0
    assert np.all(np.isfinite(localization.T_world_body))
