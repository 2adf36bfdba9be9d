# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from vislam_ros.core.gating import mahalanobis_squared, passes_gates
from vislam_ros.core.settings import SlamSettings


def test_the_chi_square_gate_lets_its_share_of_honest_innovations_pass():
    rng = np.random.default_rng(19)
    half = rng.standard_normal((20000, 3, 3))
    covariance = half @ np.swapaxes(half, 1, 2) + 0.1 * np.eye(3)
    root = np.linalg.cholesky(covariance)
    residual = (root @ rng.standard_normal((20000, 3, 1)))[..., 0]
    # 16.27 is the 99.9 % quantile of chi-square with 3 degrees of freedom.
    passed = passes_gates(SlamSettings(chi2_gate=16.27), residual, covariance)
    assert 0.0003 < 1 - passed.mean() < 0.002
    assert abs(mahalanobis_squared(residual, covariance).mean() - 3) < 0.1


def test_the_pixel_gate_bounds_each_component():
    residual = np.array([[0.0, 4.9, 0.0], [0.0, 0.0, -5.1]])
    covariance = 100 * np.broadcast_to(np.eye(3), (2, 3, 3))
    passed = passes_gates(SlamSettings(pixel_gate=5.0, chi2_gate=0.0), residual, covariance)
    assert passed.tolist() == [True, False]


def test_gates_at_zero_are_off():
    residual, covariance = np.full((1, 3), 1e6), np.eye(3)[None]
    assert passes_gates(SlamSettings(pixel_gate=0.0, chi2_gate=0.0), residual, covariance).all()


def test_a_non_finite_innovation_never_passes():
    residual, covariance = np.array([[np.nan, 0, 0], [np.inf, 0, 0]]), np.stack([np.eye(3)] * 2)
    assert not passes_gates(SlamSettings(chi2_gate=0.0), residual, covariance).any()


def test_no_observations_pass_no_gate():
    assert passes_gates(SlamSettings(), np.empty((0, 3)), np.empty((0, 3, 3))).shape == (0,)
