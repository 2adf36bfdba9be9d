# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numerics import CAMERA, difference
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.filters import robocentric_model as model
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.warp import warp
from vislam_ros.core.operations.correction import VehicleCorrection

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
    F = np.zeros((24, 24))
    F[: model.SIZE, : model.SIZE] = transition.vehicle
    for i in range(2):
        own = slice(model.SIZE + 3 * i, model.SIZE + 3 * i + 3)
        F[own, own] = transition.landmarks[i]
        F[own, 6 : model.SIZE] = transition.coupling[i]
    assert_allclose(F, difference(error_after, np.zeros(24)), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("slip_std", "rows"), [(0.25, 8), (0.0, 6)])
def test_a_measured_twist_tells_twist_and_biases_and_that_a_vehicle_goes_where_it_points(
    slip_std: float, rows: int
) -> None:
    measurement = model.TwistMeasurement(slip_std, axle_distance=2.0)
    measured = TWIST + 0.1

    def correction(state: Array) -> VehicleCorrection:
        twist = TWIST + state[model.TWIST]
        error = measurement.error(
            measured, twist, state[model.GYRO_BIAS], state[model.VELOCITY_BIAS]
        )
        return measurement.correction(error, np.full(6, 0.01), twist, SECONDS)

    at_zero = np.zeros(model.SIZE)
    H = -difference(lambda state: correction(state).residual, at_zero)
    assert_allclose(correction(at_zero).H, H, atol=1e-8)
    assert H.shape == (rows, model.SIZE)
    assert_allclose(correction(at_zero).residual[6:], [-0.4, 0.2][: rows - 6])
    # The origin is off the axle by 2 m: it sways with yaw and pitch.
    slip = 0.25**2 / SECONDS + np.square([2.0 * 0.3, 2.0 * 0.05])
    assert_allclose(correction(at_zero).noise[6:], slip[: rows - 6])


def test_of_what_is_known_at_the_start_biases_walk_and_all_is_uncertain() -> None:
    settings = RobocentricSettings(
        prior_pose_variance=0.5, gyro_bias_walk_std=0.2, velocity_bias_walk_std=0.1
    )
    expected = [0.0] * 12 + [0.04] * 3 + [0.01] * 2 + [0.0]
    assert_allclose(model.walk_densities(settings), expected)
    prior = np.diag(model.prior_covariance(settings))
    assert_allclose(prior[model.POSE], 0.5)
    assert prior[model.LENS] == settings.lens_distortion_std**2
    assert np.all(prior > 0)
