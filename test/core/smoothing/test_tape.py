# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.operations.correction import VehicleCorrection
from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.transition import RandomWalk
from vislam_ros.core.smoothing import tape as module
from vislam_ros.core.smoothing.backward import smooth
from vislam_ros.core.smoothing.tape import Tape


def test_there_is_a_checkpoint_at_the_start_and_after_so_many_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_STEPS_BETWEEN_CHECKPOINTS", 3)
    tape = Tape()
    state = ErrorState(np.eye(6), 6, tape)
    for _ in range(7):
        state.apply(RandomWalk(np.eye(6)))
        state.end_step(np.eye(4))
    assert tape.vehicle_size == 6
    assert [checkpoint.covariance[0, 0] for checkpoint in tape.checkpoints] == [1.0, 4.0, 7.0]
    assert [len(checkpoint.operations) for checkpoint in tape.checkpoints] == [6, 6, 2]


@pytest.mark.parametrize("steps", [4, 6])
def test_what_is_said_of_the_last_step_is_heard_on_the_way_back_as_if_it_had_been_done(
    steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of 6 steps the last ends at a checkpoint.
    monkeypatch.setattr(module, "_STEPS_BETWEEN_CHECKPOINTS", 3)
    said, done, silent = Tape(), Tape(), Tape()
    heard = VehicleCorrection(np.array([0.3]), np.array([0.5]), np.eye(1, 6))
    for tape in (said, done, silent):
        state = ErrorState(np.eye(6), 6, tape)
        for _ in range(steps):
            state.apply(RandomWalk(np.eye(6)))
            # What is said of other steps than the last is forgotten.
            state.end_step(np.eye(4), heard if tape is said else None)
        if tape is done:
            state.apply(heard)
    found, expected, otherwise = smooth(said), smooth(done), smooth(silent)
    np.testing.assert_allclose(found.poses, expected.poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.pose_covariances, expected.pose_covariances, atol=1e-12)
    assert found.poses[0][0, 3] > otherwise.poses[0][0, 3]
