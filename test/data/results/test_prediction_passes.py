# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math

from vislam_ros.data.results.prediction_passes import _MOST_AHEAD, PredictionPasses

STEP = 100_000_000


def entered(*numbers: int) -> PredictionPasses[str]:
    passes: PredictionPasses[str] = PredictionPasses()
    for number in numbers:
        passes.enter(number * STEP, f"pose {number}")
    return passes


def test_poses_ahead_of_a_stamp_wait_for_it() -> None:
    passes = entered(1, 2, 3)
    assert list(passes.take(0, -math.inf)) == []
    assert list(passes.take(0, 2 * STEP)) == [(0, STEP, "pose 1"), (0, 2 * STEP, "pose 2")]
    assert list(passes.take(0, 2 * STEP)) == []
    assert [pose for *_, pose in passes.take(0, math.inf)] == ["pose 3"]


def test_a_later_time_pass_waits_for_its_own_steps() -> None:
    passes = entered(101, 102, 1, 2)
    assert passes.time_pass == 1
    assert [pose for *_, pose in passes.take(0, math.inf)] == ["pose 101", "pose 102"]
    assert list(passes.take(1, STEP)) == [(1, STEP, "pose 1")]


def test_what_is_left_of_an_earlier_time_pass_comes_with_the_next() -> None:
    passes = entered(101, 102, 1, 2)
    assert [time_pass for time_pass, *_ in passes.take(1, STEP)] == [0, 0, 1]


def test_poses_are_not_kept_without_end_where_no_step_comes() -> None:
    passes = entered(*range(_MOST_AHEAD + 3))
    assert [pose for *_, pose in passes.take(0, -math.inf)] == ["pose 0", "pose 1", "pose 2"]
    assert len(list(passes.take(0, math.inf))) == _MOST_AHEAD
