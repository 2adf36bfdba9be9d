# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.operations.correction import Correction, VehicleCorrection
from vislam_ros.core.operations.error_state import ErrorState

Array = NDArray[np.float64]

S, LANDMARKS, SIZE = 7, 5, 22


def random_state(rng: np.random.Generator) -> ErrorState:
    half = rng.standard_normal((SIZE, SIZE))
    return ErrorState(half @ half.T, S)


def textbook(P: Array, H: Array, R: Array, residual: Array) -> tuple[Array, Array, float]:
    """Covariance and move by the report's eq. 69-71, and the NIS."""
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return P - K @ H @ P, K @ residual, float(residual @ np.linalg.solve(S, residual))


def random_correction(rng: np.random.Generator) -> tuple[Correction, Array]:
    """Correct by four landmarks in any order; return the whole H (4, 3, 22), too."""
    slots = rng.permutation(LANDMARKS)[:4]
    correction = Correction(
        residual=rng.standard_normal((4, 3)),
        noise=np.diag([0.5, 1.0, 2.0]),
        H_vehicle=rng.standard_normal((4, 3, S)),
        H_landmark=rng.standard_normal((4, 3, 3)),
        slots=slots,
    )
    H = np.zeros((4, 3, SIZE))
    H[:, :, :S] = correction.H_vehicle
    for i, slot in enumerate(slots):
        H[i, :, S + 3 * slot : S + 3 * slot + 3] = correction.H_landmark[i]
    return correction, H


@pytest.mark.parametrize("gated", [True, False], ids=["after a gate", "by itself"])
def test_correcting_by_some_landmarks_is_the_textbook_correction(gated: bool) -> None:
    rng = np.random.default_rng(31)
    state, (correction, H) = random_state(rng), random_correction(rng)
    P = state.covariance.copy()
    inliers = np.array([True, False, True, True])
    by = correction.by(inliers, correction.innovation_in(state).of(inliers, state.scratch))
    corrected = state.apply(by if gated else by.recorded())
    noise = scipy.linalg.block_diag(*[correction.noise] * 3)
    expected, delta, nis = textbook(
        P,
        H[inliers].reshape(9, SIZE),
        noise,
        correction.residual[inliers].ravel(),
    )
    assert_allclose(state.covariance, expected, atol=1e-10)
    assert_allclose(corrected.delta, delta, atol=1e-10)
    assert corrected.nis == pytest.approx(nis)


def test_a_gate_sees_the_covariance_of_each_innovation() -> None:
    rng = np.random.default_rng(32)
    state, (correction, H) = random_state(rng), random_correction(rng)
    covariances = correction.innovation_in(state).covariances()
    for own, covariance in zip(H, covariances, strict=True):
        assert_allclose(covariance, own @ state.covariance @ own.T + correction.noise)


def test_correcting_the_vehicle_is_the_textbook_correction() -> None:
    rng = np.random.default_rng(33)
    state = random_state(rng)
    P, R, H, residual = state.covariance.copy(), rng.random(3), np.zeros((3, SIZE)), rng.random(3)
    H[:, :S] = rng.standard_normal((3, S))
    corrected = state.apply(VehicleCorrection(residual, R, H[:, :S].copy()))
    expected, delta, nis = textbook(P, H, np.diag(R), residual)
    assert_allclose(state.covariance, expected, atol=1e-10)
    assert_allclose(corrected.delta, delta, atol=1e-10)
    assert corrected.nis == pytest.approx(nis)


def test_a_tape_is_spared_what_can_be_worked_out_again() -> None:
    rng = np.random.default_rng(34)
    state, (correction, _) = random_state(rng), random_correction(rng)
    by = correction.by(np.ones(4, dtype=bool), correction.innovation_in(state))
    assert by.innovation is not None
    assert by.recorded().innovation is None
    assert by.recorded().residual is by.residual
