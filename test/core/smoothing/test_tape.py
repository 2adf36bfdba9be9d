# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.transition import RandomWalk
from vislam_ros.core.smoothing import tape as module
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
