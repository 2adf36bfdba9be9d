# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numpy.testing import assert_array_equal

from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.marginalization import Marginalization, WorldPositions


def nobody_asks() -> WorldPositions:
    raise AssertionError("positions are worked out in the step of a filter")


def test_what_stays_keeps_its_covariance_and_no_position_is_worked_out() -> None:
    half = np.random.default_rng(61).standard_normal((15, 15))
    P = half @ half.T
    state = ErrorState(P, 6)
    gone = np.array([False, True, False])
    state.apply(Marginalization(np.array([7]), gone, nobody_asks))
    stays = np.r_[0:9, 12:15]
    assert_array_equal(state.covariance, P[np.ix_(stays, stays)])
    assert state.active == 2
