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
from vislam_ros.core.operations.innovations import Shown

Array = NDArray[np.float64]

TWIST = np.array([8.0, 0.4, -0.2, 0.02, -0.05, 0.3])
VEHICLE = model.Vehicle(twist=TWIST, drift=np.array([0.05, -0.02, 0.1]))
SECONDS = 0.1


def test_the_transition_is_the_motions_derivative_by_finite_differences() -> None:
    rng = np.random.default_rng(71)
    left = rng.uniform([300, 100], [900, 250], (2, 2))
    y = np.column_stack([left[:, 0], left[:, 0] - rng.uniform(5, 30, 2), left[:, 1]])
    _, warped, transition = model.motion_of(CAMERA, y, VEHICLE, SECONDS)
    motion = se3.exp(SECONDS * VEHICLE.body_twist)
    D, D_new = radial_shift(CAMERA, y), radial_shift(CAMERA, warped.y)

    def error_after(error: Array) -> Array:
        true = VEHICLE.shifted(error[: model.SIZE])
        true_twist, kappa = true.twist, error[model.LENS]
        moved = true.moved(se3.exp(SECONDS * true.body_twist)).T_world_body
        true_y = y + error[model.SIZE :].reshape(2, 3) + kappa * D
        seen = warp(CAMERA, true_y, se3.exp(SECONDS * true_twist)).y
        after = error.copy()
        after[model.POSE] = se3.log(se3.inverse(motion) @ moved)
        after[model.SIZE :] = (seen - warped.y - kappa * D_new).ravel()
        return after

    F = np.zeros((25, 25))
    F[: model.SIZE, : model.SIZE] = transition.vehicle
    for i in range(2):
        own = slice(model.SIZE + 3 * i, model.SIZE + 3 * i + 3)
        F[own, own] = transition.landmarks[i]
        F[own, 6 : model.SIZE] = transition.coupling[i]
    assert_allclose(F, difference(error_after, np.zeros(25)), rtol=1e-5, atol=1e-5)


def test_a_measured_twist_tells_the_bodys_twist_and_the_bias() -> None:
    measured = VEHICLE.body_twist + 0.1
    given = measured.copy()

    def error(state: Array) -> Array:
        return model.twist_error(measured, VEHICLE.shifted(state))

    at_zero = np.zeros(model.SIZE)
    assert_allclose(error(at_zero), 0.1)
    assert_allclose(model.TWIST_ROWS, -difference(error, at_zero), atol=1e-8)
    # The measured twist is the caller's.
    assert_allclose(measured, given)
    by_state = difference(lambda state: VEHICLE.shifted(state).body_twist, at_zero)
    assert_allclose(model.BODY_TWIST_ROWS, by_state, atol=1e-8)


def test_of_what_is_known_at_the_start_the_bias_walks_and_all_is_uncertain() -> None:
    settings = RobocentricSettings(prior_pose_variance=0.5, gyro_bias_walk_std=0.2)
    walk = model.random_walk(settings, np.arange(1.0, 7.0), 0.0, SECONDS)
    expected = [0.0] * 6 + [1.0, 2.0, 3.0, 4.0, 5.0, 6.0] + [0.04] * 3 + [0.0] * 4
    assert_allclose(walk.noise, SECONDS * np.diag(expected))
    prior = np.diag(model.prior_covariance(settings))
    assert_allclose(prior[model.POSE], 0.5)
    assert prior[model.LENS] == settings.lens_distortion_std**2
    assert_allclose(prior[model.DRIFT], 0.0)
    assert np.all(prior[: model.LENS + 1] > 0)


def test_vision_drifts_with_the_way_however_it_is_cut_into_steps() -> None:
    """The variance of the angle over 12 m is the same in 3 steps and in 30."""

    def angle_variance(steps: int) -> float:
        tau = 1.2 / steps
        walk = model.random_walk(RobocentricSettings(), np.zeros(6), 10.0, tau)
        return steps * tau**2 * float(walk.noise[model.DRIFT, model.DRIFT][0, 0])

    assert_allclose(angle_variance(3), angle_variance(30))
    assert_allclose(angle_variance(30) ** 0.5, 0.13e-3 * 12.0**0.5)


def judged(shown_twist: Array, *, numbers: int = 60, by_most: bool = True) -> model.Belied:
    """Judge a twist that is measured as 2 m/s, where none was foreseen, by what images show."""
    P = np.diag(np.concatenate([np.ones(6), np.full(6, 0.01), np.full(7, 1e-6)]))
    measured = np.array([2.0, 0, 0, 0, 0, 0])
    measurement = model.twist_correction(measured, model.Vehicle(), np.full(6, 0.01))
    delta = np.zeros(model.SIZE)
    delta[model.TWIST] = shown_twist
    return model.belied(measurement, P, Shown(delta, P, by_most, numbers), 16.27)


STILL, MEASURED = np.zeros(6), np.array([2.0, 0, 0, 0, 0, 0])


def test_images_tell_whether_the_measured_twist_is_wrong_or_the_one_foreseen() -> None:
    assert judged(STILL) == model.Belied(measured=True)
    assert judged(MEASURED) == model.Belied(foreseen=True)


def test_images_that_belie_both_or_none_or_do_not_agree_decide_nothing() -> None:
    assert not any(judged(-MEASURED))
    assert not any(judged(MEASURED / 2))
    assert not any(judged(STILL, by_most=False))
    assert not any(judged(STILL, numbers=6))


def test_a_twist_is_forgotten_to_what_is_known_at_the_start() -> None:
    P = model.prior_covariance(RobocentricSettings())
    assert not model.forgotten_twist(P).noise.any()
    known = P.copy()
    known[model.TWIST, model.TWIST] *= 1e-4
    assert_allclose(known + model.forgotten_twist(known).noise, P)
