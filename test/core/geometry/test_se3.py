# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]

vectors = arrays(float, 6, elements=st.floats(-3, 3, allow_subnormal=False))
# Rotations shorter than pi, where the logarithm is unique.
twists = vectors.map(lambda xi: np.concatenate([10 * xi[:3], xi[3:] * 0.55]))
scales = st.sampled_from([1.0, 1e-1, 1e-2, 0.99e-2, 1e-4, 1e-8, 1e-12, 0.0])


def matrix_of(xi: Array) -> Array:
    M = np.zeros((4, 4))
    M[:3, :3], M[:3, 3] = se3.hat(xi[3:]), xi[:3]
    return M


@given(twists, scales)
def test_exp_is_the_matrix_exponential(xi: Array, scale: float) -> None:
    xi = xi * scale
    assert_allclose(se3.exp(xi), scipy.linalg.expm(matrix_of(xi)), atol=1e-12)


@given(twists, scales)
def test_log_undoes_exp(xi: Array, scale: float) -> None:
    xi = xi * scale
    assert_allclose(se3.log(se3.exp(xi)), xi, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("axis", [*np.eye(3).tolist(), [0.6, -0.8, 0.0]])
def test_log_holds_up_to_a_half_turn(axis: list[float]) -> None:
    theta = (np.pi - 1e-9) * np.array(axis)
    assert_allclose(np.abs(se3.log_rotation(se3.exp_rotation(theta))), np.abs(theta), atol=1e-7)


@given(twists, vectors)
def test_the_adjoint_moves_a_tangent_through_a_pose(a: Array, b: Array) -> None:
    T, xi = se3.exp(a), 0.1 * b
    assert_allclose(T @ se3.exp(xi), se3.exp(se3.adjoint(T) @ xi) @ T, atol=1e-9)


@given(vectors, vectors)
def test_odot_swaps_the_factors_of_hat_times_point(xi: Array, s: Array) -> None:
    assert_allclose(matrix_of(xi) @ s[:4], se3.odot(s[:4]) @ xi, atol=1e-12)


@given(twists)
def test_inverse_times_pose_is_the_identity(xi: Array) -> None:
    T = se3.exp(xi)
    assert_allclose(se3.inverse(T) @ T, np.eye(4), atol=1e-12)


@given(twists)
def test_quaternion_and_rotation_are_one_thing(xi: Array) -> None:
    R = se3.exp_rotation(xi[3:])
    q = se3.quaternion_from_rotation(R)
    assert q[3] >= 0
    assert_allclose(np.linalg.norm(q), 1, atol=1e-14)
    assert_allclose(se3.rotation_from_quaternion(q), R, atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_a_half_turn_about_each_axis(axis: int) -> None:
    R = -np.eye(3)
    R[axis, axis] = 1
    q = se3.quaternion_from_rotation(R)
    assert_allclose(q, np.eye(4)[axis])


def test_batches_give_what_single_calls_give() -> None:
    rng = np.random.default_rng(1)
    xi = rng.standard_normal((5, 2, 6))
    T = se3.exp(xi)
    for index in np.ndindex(5, 2):
        assert_allclose(T[index], se3.exp(xi[index]), atol=1e-15)
        assert_allclose(se3.log(T)[index], se3.log(T[index]), atol=1e-15)
        assert_allclose(se3.adjoint(T)[index], se3.adjoint(T[index]), atol=1e-15)
        assert_allclose(se3.inverse(T)[index], se3.inverse(T[index]), atol=1e-15)


def test_interpolation_runs_along_a_constant_twist() -> None:
    rng = np.random.default_rng(2)
    T_a, xi = se3.exp(rng.standard_normal(6)), 0.5 * rng.standard_normal(6)
    T_b = T_a @ se3.exp(xi)
    assert_allclose(se3.interpolate(T_a, T_b, 0.0), T_a, atol=1e-12)
    assert_allclose(se3.interpolate(T_a, T_b, 0.3), T_a @ se3.exp(0.3 * xi), atol=1e-12)
    assert_allclose(se3.interpolate(T_a, T_b, 1.0), T_b, atol=1e-12)


def test_the_nearest_rotation_is_one_and_leaves_rotations_alone() -> None:
    rng = np.random.default_rng(3)
    R = se3.exp_rotation(rng.standard_normal(3))
    assert_allclose(se3.nearest_rotation(R), R, atol=1e-14)
    repaired = se3.nearest_rotation(R + 1e-3 * rng.standard_normal((3, 3)))
    assert_allclose(repaired @ repaired.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(repaired) > 0
    assert_allclose(repaired, R, atol=5e-3)


@given(twists, vectors)
def test_the_right_jacobian_is_the_derivative_of_exp(xi: Array, d: Array) -> None:
    step = 1e-6 * d
    expected = se3.log(se3.inverse(se3.exp(xi - step)) @ se3.exp(xi + step)) / 2e-6
    assert_allclose(se3.right_jacobian(xi) @ d, expected, atol=1e-6)


def test_the_right_jacobian_holds_for_many_turns() -> None:
    xi, d = np.array([1.0, -2, 3, 30, -20, 40]), np.array([0.3, -0.1, 0.2, 0.1, 0.4, -0.2])
    step = 1e-6 * d
    expected = se3.log(se3.inverse(se3.exp(xi - step)) @ se3.exp(xi + step)) / 2e-6
    assert_allclose(se3.right_jacobian(xi) @ d, expected, atol=1e-6)
