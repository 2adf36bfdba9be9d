# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from vislam_ros.core.operations.correction import VehicleCorrection
from vislam_ros.core.operations.error_state import ErrorState, Operation, PoseMark
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.transition import RandomWalk

Array = NDArray[np.float64]
S = 7


class Listener:
    """A tape that keeps all it is given."""

    def __init__(self) -> None:
        self.operations: list[Operation[Any]] = []
        self.covariances: list[Array] = []
        self.last: Operation[Any] | None = None

    def begin(self, vehicle_size: int, covariance: Array) -> None:
        assert vehicle_size == S
        self.covariances.append(covariance.copy())

    def record(self, operation: Operation[Any]) -> None:
        self.operations.append(operation)

    def end_step(self, covariance: Array, last: Operation[Any] | None) -> None:
        self.last = last
        self.covariances.append(covariance.copy())


def test_what_is_applied_is_recorded_and_each_step_ends_at_its_pose() -> None:
    tape = Listener()
    state = ErrorState(np.eye(S), S, tape)
    walk, joining = RandomWalk(np.eye(S)), Initialization(np.ones((2, 3, 3)))
    state.apply(walk)
    state.apply(joining)
    state.end_step(2 * np.eye(4))
    assert tape.operations[:2] == [walk, joining]
    assert isinstance(tape.operations[2], PoseMark)
    assert_array_equal(tape.operations[2].T_world_body, 2 * np.eye(4))
    assert_array_equal(tape.covariances[0], np.eye(S))
    assert_array_equal(tape.covariances[1], state.covariance)
    assert tape.last is None


def test_what_is_said_of_the_whole_drive_is_told_to_the_tape_and_not_applied() -> None:
    tape = Listener()
    state = ErrorState(np.eye(S), S, tape)
    last = VehicleCorrection(np.zeros(1), np.ones(1), np.eye(1, S))
    state.end_step(np.eye(4), last)
    assert tape.last is last
    assert len(tape.operations) == 1
    assert_array_equal(state.covariance, np.eye(S))


def test_an_operation_that_fails_changes_and_records_nothing() -> None:
    tape = Listener()
    state = ErrorState(np.eye(S), S, tape)
    impossible = VehicleCorrection(np.zeros(1), np.array([-2.0]), np.eye(1, S))
    with pytest.raises(np.linalg.LinAlgError):
        state.apply(impossible)
    assert tape.operations == []
    assert_array_equal(state.covariance, np.eye(S))


def test_a_downdate_that_was_put_off_is_there_for_whoever_looks() -> None:
    Y = np.full((2, S), 0.1)
    for look in (
        lambda state: state.covariance,
        lambda state: state.vehicle_covariance,
        # A second one does not take the place of the first.
        lambda state: (state.defer_downdate(0 * Y), state.covariance)[1],
    ):
        state = ErrorState(np.eye(S), S)
        state.defer_downdate(Y)
        assert_allclose(look(state), np.eye(S) - Y.T @ Y, rtol=0, atol=1e-15)
        P, rows = state.take_downdate()
        assert rows.shape == (0, S)
        assert_allclose(P, np.eye(S) - Y.T @ Y, rtol=0, atol=1e-15)


def test_the_error_state_is_its_own_and_knows_where_its_landmarks_are() -> None:
    P = np.diag(np.arange(1.0, S + 7.0))
    state = ErrorState(P, S)
    P[:] = 0.0
    assert state.active == 2
    assert state.rows_of(np.array([1, 0])).tolist() == [[10, 11, 12], [7, 8, 9]]
    assert_array_equal(state.vehicle_covariance, np.diag(np.arange(1.0, 8.0)))
    assert_array_equal(state.landmark_covariances()[1], np.diag([11.0, 12.0, 13.0]))
