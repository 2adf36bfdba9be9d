# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import difference, random_pose
from numpy.testing import assert_allclose

from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment, mean_twist, process_covariance, propagate
from vislam_ros.core.settings import MotionSettings


def test_transition_is_the_finite_difference_of_the_prediction():
    rng = np.random.default_rng(5)
    T, step = random_pose(rng), se3.exp(0.3 * rng.standard_normal(6))
    increment = Increment(step, 0.1, np.zeros((6, 6)))

    def error_after(xi):
        return se3.log(se3.inverse(T @ step) @ (T @ se3.exp(xi) @ step))

    assert_allclose(increment.transition, difference(error_after, np.zeros(6)), atol=1e-8)


def test_white_twist_noise_moves_the_pose_by_sigma_tau():
    settings = MotionSettings(velocity_noise_std=0.5, angular_velocity_noise_std=0.05)
    W = process_covariance(settings, 0.1)
    assert_allclose(np.sqrt(np.diag(W)), [0.05, 0.05, 0.05, 0.005, 0.005, 0.005])


def test_noise_of_the_parts_of_a_sample_adds_up_to_the_whole():
    for model in ("white_twist", "constant"):
        settings = MotionSettings(process_noise=model)
        parts = [process_covariance(settings, 0.1, share) for share in (0.3, 0.7)]
        assert_allclose(sum(parts), process_covariance(settings, 0.1))


def test_propagated_covariance_is_that_of_a_monte_carlo():
    rng = np.random.default_rng(6)
    step = se3.exp([1.0, 0.1, 0.0, 0.05, -0.1, 0.2])
    half = 0.02 * rng.standard_normal((6, 6))
    Sigma, W = half @ half.T, np.diag([1e-4, 2e-4, 3e-4, 1e-5, 2e-5, 3e-5])
    errors = rng.multivariate_normal(np.zeros(6), Sigma, 20000)
    noises = rng.multivariate_normal(np.zeros(6), W, 20000)
    after = se3.exp(errors) @ step @ se3.exp(noises)
    sampled = np.cov(se3.log(se3.inverse(step) @ after).T)
    predicted = propagate(Sigma, Increment(step, 0.1, W))
    assert_allclose(sampled, predicted, atol=0.03 * np.abs(predicted).max())


def test_the_twist_of_an_increment_has_the_covariance_of_a_monte_carlo():
    rng = np.random.default_rng(7)
    tau, step = 0.5, se3.exp([5.0, 0.5, -0.2, 0.1, -0.2, 0.6])
    W = np.diag([1e-2, 2e-2, 3e-2, 1e-4, 2e-4, 3e-4])
    noises = rng.multivariate_normal(np.zeros(6), W, 20000)
    twist = mean_twist(Increment(step, tau, W))
    assert_allclose(se3.exp(tau * twist.mean), step, atol=1e-12)
    sampled = np.cov(se3.log(step @ se3.exp(noises)).T / tau)
    assert_allclose(sampled, twist.covariance, atol=0.03 * np.abs(twist.covariance).max())


def test_before_any_motion_the_twist_may_be_any_vehicle_s():
    twist = mean_twist(Increment(np.eye(4), 0.0, np.zeros((6, 6))))
    assert_allclose(twist.mean, 0.0)
    assert_allclose(np.sqrt(np.diag(twist.covariance)), [50.0, 50.0, 50.0, 2.0, 2.0, 2.0])
