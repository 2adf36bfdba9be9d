# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA, difference
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.filters import robocentric_model as model
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.warp import warp

Array = NDArray[np.float64]

TWIST = np.array([8.0, 0.4, -0.2, 0.02, -0.05, 0.3])
SECONDS = 0.1


def test_the_transition_is_the_motions_derivative_by_finite_differences() -> None:
    rng = np.random.default_rng(71)
    left = rng.uniform([300, 100], [900, 250], (2, 2))
    y = np.column_stack([left[:, 0], left[:, 0] - rng.uniform(5, 30, 2), left[:, 1]])
    motion = se3.exp(SECONDS * TWIST)
    warped = warp(CAMERA, y, motion)
    D, D_new = radial_shift(CAMERA, y), radial_shift(CAMERA, warped.y)

    def error_after(error: Array) -> Array:
        true_twist, kappa = TWIST + error[model.TWIST], error[model.LENS]
        moved = se3.exp(error[model.POSE]) @ se3.exp(SECONDS * true_twist)
        true_y = y + error[model.SIZE :].reshape(2, 3) + kappa * D
        seen = warp(CAMERA, true_y, se3.exp(SECONDS * true_twist)).y
        after = error.copy()
        after[model.POSE] = se3.log(se3.inverse(motion) @ moved)
        after[model.SIZE :] = (seen - warped.y - kappa * D_new).ravel()
        return after

    transition = model.transition_of(CAMERA, y, warped, motion, TWIST, SECONDS)
    F = np.zeros((22, 22))
    F[: model.SIZE, : model.SIZE] = transition.vehicle
    for i in range(2):
        own = slice(model.SIZE + 3 * i, model.SIZE + 3 * i + 3)
        F[own, own] = transition.landmarks[i]
        F[own, 6 : model.SIZE] = transition.coupling[i]
    assert_allclose(F, difference(error_after, np.zeros(22)), rtol=1e-5, atol=1e-5)


def test_a_measured_twist_tells_twist_and_bias() -> None:
    measured = TWIST + 0.1

    def error(state: Array) -> Array:
        return model.twist_error(measured, TWIST + state[model.TWIST], state[model.GYRO_BIAS])

    at_zero = np.zeros(model.SIZE)
    assert_allclose(error(at_zero), 0.1)
    assert_allclose(model.TWIST_ROWS, -difference(error, at_zero), atol=1e-8)
    # The measured twist is the caller's.
    assert_allclose(measured, TWIST + 0.1)


def test_of_what_is_known_at_the_start_the_bias_walks_and_all_is_uncertain() -> None:
    settings = RobocentricSettings(prior_pose_variance=0.5, gyro_bias_walk_std=0.2)
    expected = [0.0] * 12 + [0.04] * 3 + [0.0]
    assert_allclose(model.walk_densities(settings), expected)
    prior = np.diag(model.prior_covariance(settings))
    assert_allclose(prior[model.POSE], 0.5)
    assert prior[model.LENS] == settings.lens_distortion_std**2
    assert np.all(prior > 0)
