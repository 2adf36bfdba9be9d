# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A single motion and a batch of them give the same."""

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3, se3_single

ANGLES = [0.0, 1e-12, 1e-5, 0.99e-2, 1.01e-2, 0.099, 0.101, 1.0, 3.0, np.pi - 1e-9]
AXES = [np.eye(3)[k] for k in range(3)] + [
    np.array([-0.6, 0.0, 0.8]),
    np.array([0.48, -0.6, 0.64]),
]


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("axis", AXES, ids=str)
def test_a_single_motion_is_that_of_the_batch(angle: float, axis: NDArray[np.float64]) -> None:
    xi = np.concatenate([[3.0, -20.0, 0.5], angle * axis])
    T = se3.exp(xi[None])
    assert_allclose(se3_single.exp(xi), T[0], rtol=0, atol=1e-14)
    assert_allclose(se3_single.log(T[0]), se3.log(T)[0], rtol=0, atol=1e-13)
    R = T[:, :3, :3]
    quaternion = se3_single.quaternion_from_rotation(R[0])
    assert_allclose(quaternion, se3.quaternion_from_rotation(R)[0], rtol=0, atol=1e-15)
    assert_allclose(se3_single.inverse(T[0]), se3.inverse(T)[0], rtol=0, atol=1e-14)
    assert_allclose(se3_single.adjoint(T[0]), se3.adjoint(T)[0], rtol=0, atol=1e-14)
    again = se3_single.rotation_from_quaternion(3.0 * quaternion)
    assert_allclose(again, R[0], rtol=0, atol=1e-14)


def test_a_quaternion_of_length_zero_is_no_rotation() -> None:
    assert np.all(np.isnan(np.diag(se3_single.rotation_from_quaternion(np.zeros(4)))))


@pytest.mark.parametrize("angle", [*ANGLES, 40.0])
def test_the_right_jacobian_is_the_mean_of_the_adjoints_on_the_way_back(angle: float) -> None:
    xi = np.concatenate([[3.0, -20.0, 0.5], angle * AXES[-1]])
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = se3.hat(xi[3:])
    ad[:3, 3:] = se3.hat(xi[:3])
    # The integral of expm(-s ad) over s from 0 to 1, read off one larger exponential.
    both = scipy.linalg.expm(np.block([[-ad, np.eye(6)], [np.zeros((6, 12))]]))
    assert_allclose(se3.right_jacobian(xi), both[:6, 6:], rtol=0, atol=1e-9)
