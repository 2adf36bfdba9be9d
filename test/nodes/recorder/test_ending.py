# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a recording ends that is told to, while the graph goes on."""

import pytest

from vislam_ros.nodes.recorder.ending import LINGERING_SECONDS, QUIET_SECONDS, Ending
from vislam_ros.nodes.recorder.map_request import map_answer, stamp_of_map_answer


@pytest.fixture
def ending():
    """One that was told at 100 s, after 10 messages."""
    return Ending(100.0, 10)


def test_steps_are_held_until_the_last_one_is_known(ending):
    assert [ending.take(stamp, f"step {stamp}") for stamp in (5, 6, 7)] == [[], [], []]
    assert ending.end_at(6, 4, 100.0) == ["step 5", "step 6"]
    assert ending.take(8, "step 8") == []
    assert ending.end_here() == []


def test_steps_on_their_way_to_the_last_one_are_let_through(ending):
    ending.take(5, "step 5")
    assert ending.end_at(7, 4, 100.0) == ["step 5"]
    assert [ending.take(stamp, f"step {stamp}") for stamp in (6, 7, 8)] == [
        ["step 6"],
        ["step 7"],
        [],
    ]


def test_a_last_step_that_is_written_already_lets_nothing_more_through(ending):
    ending.take(5, "step 5")
    assert ending.end_at(4, 4, 100.0) == []
    assert ending.take(6, "step 6") == []
    assert ending.end_here() == []


def test_the_first_answer_counts(ending):
    ending.take(5, "step 5")
    ending.end_at(5, 4, 100.0)
    assert ending.end_at(9, 5, 100.0) == []
    assert ending.last == 5


@pytest.mark.parametrize("comes", [True, False])
def test_a_last_step_that_is_not_here_is_waited_for_until_nothing_comes_any_more(ending, comes):
    ending.take(5, "step 5")
    ending.note_empty(110.0, 10, more_may_come=True)
    assert ending.is_quiet(110.0)
    assert not ending.is_missed  # nobody has said yet which one it is
    ending.end_at(6, 4, 110.0)
    ending.note_empty(110.0 + 0.9 * QUIET_SECONDS, 10, more_may_come=True)
    assert not ending.is_missed
    if comes:
        assert ending.take(6, "step 6") == ["step 6"]
    ending.note_empty(110.0 + 1.1 * QUIET_SECONDS, 10, more_may_come=True)
    assert ending.is_missed is not comes


def test_without_an_answer_all_steps_are_written(ending):
    ending.take(5, "step 5")
    assert ending.end_here() == ["step 5"]
    assert ending.end_here() == []


def test_it_is_quiet_when_nothing_came_for_a_while(ending):
    for inputs, seconds, is_quiet in (
        (10, 0.0, False),
        (10, 0.9, False),
        (10, 1.1, True),
        (11, 1.2, False),
        (11, 2.3, True),
    ):
        now = 100.0 + seconds * QUIET_SECONDS
        ending.note_empty(now, inputs, more_may_come=True)
        assert ending.is_quiet(now) is is_quiet


def test_time_alone_makes_nothing_quiet_while_more_may_wait_to_be_taken(ending):
    ending.note_empty(100.0, 10, more_may_come=True)
    assert not ending.is_quiet(100.0 + 10 * QUIET_SECONDS)


def test_a_stream_that_does_not_end_is_not_waited_for_forever(ending):
    assert [ending.is_quiet(100.0 + k) for k in (1, 4, 6)] == [False, False, True]


def test_after_a_while_one_moment_is_enough_at_which_nothing_waits(ending):
    ending.note_empty(100.0 + 0.9 * LINGERING_SECONDS, 11, more_may_come=True)
    assert not ending.is_quiet(101.0)
    ending.note_empty(100.0 + 1.1 * LINGERING_SECONDS, 12, more_may_come=True)
    assert ending.is_quiet(101.2)


def test_where_nobody_is_left_to_send_such_a_moment_is_enough_at_once(ending):
    ending.note_empty(100.0, 11, more_may_come=False)
    assert ending.is_quiet(100.0)


@pytest.mark.parametrize("stamp", [0, 7, 1_317_000_000_000_000_123])
def test_an_answer_tells_as_of_when_the_map_is(stamp):
    assert map_answer(12, stamp).startswith("12 landmarks as of ")
    assert stamp_of_map_answer(map_answer(12, stamp)) == stamp


@pytest.mark.parametrize("text", ["", "12 landmarks", "12 landmarks as of now s"])
def test_another_answer_is_no_stamp(text):
    with pytest.raises(ValueError, match=r"invalid literal|could not convert"):
        stamp_of_map_answer(text)
