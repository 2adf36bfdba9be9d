# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.noise.frame_rate import FrameRate


def after(durations: list[float]) -> FrameRate:
    rate = FrameRate()
    for tau in durations:
        rate.add(tau)
    return rate


@pytest.mark.parametrize("hertz", [1, 10, 15, 20, 25, 30, 60, 100])
def test_half_a_minute_holds_frames_by_the_rate(hertz: int) -> None:
    assert after([1.0 / hertz]).frames(30.0) == 30 * hertz


def test_jitter_and_lost_frames_leave_the_rate_as_it_is() -> None:
    # KITTI's stamps: 9.65 Hz by the clock, and ten by name.
    durations = 0.1036 + 0.0015 * np.random.default_rng(71).uniform(-1, 1, 200)
    durations[10::3] *= 2
    rate = FrameRate()
    for tau in durations.tolist():
        rate.add(tau)
        assert rate.frames(30.0) == 300


def test_a_new_rate_counts_within_three_seconds() -> None:
    assert after(50 * [0.1] + 20 * [0.05]).hertz == 20
    assert after(50 * [0.05] + 20 * [0.1]).hertz == 10


def test_a_span_holds_a_frame_at_least_and_a_slow_camera_counts_as_one_of_a_hertz() -> None:
    assert after([5.0]).frames(30.0) == 30
    assert after([5.0]).frames(0.1) == 1


def test_before_there_are_two_frames_the_rate_is_a_usual_one() -> None:
    assert FrameRate().hertz == 10


@pytest.mark.parametrize("hertz", [0.2, 1, 9.65, 30])
def test_a_step_over_a_hole_tells_how_many_frames_are_missing(hertz: float) -> None:
    rate = after([1.0 / hertz] * 10)
    assert [rate.missed(steps / hertz) for steps in (0.01, 0.9, 1.0, 1.4, 1.6, 2.0, 51)] == [
        *(4 * [0]),
        1,
        1,
        50,
    ]


def test_of_the_first_step_nobody_knows_whether_frames_are_missing() -> None:
    assert after([5.0]).missed(5.0) == 0
