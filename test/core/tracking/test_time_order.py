# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a stamp is late, there twice, or the first of a new pass, live and offline."""

import pytest

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, Stream
from vislam_ros.core.tracking.time_order import Passes, TimeOrder

SECOND = 1_000_000_000


def verdict(order, seconds):
    try:
        return "new pass" if order.enter(round(seconds * SECOND)) else "next"
    except RefusedMessage as error:
        return error.refusal.word


def verdicts(stamps):
    """What becomes of stamps in seconds that come one after the other."""
    order = TimeOrder(1.0)
    return [verdict(order, seconds) for seconds in stamps]


def test_only_what_is_newer_enters():
    assert verdicts([5, 6, 6, 5.5, 7]) == ["next", "next", "duplicate", "late", "next"]


def test_a_stamp_exactly_the_jump_back_is_late_and_one_before_it_begins_a_new_pass():
    assert verdicts([5, 4]) == ["next", "late"]
    assert verdicts([5, 4 - 1e-9]) == ["next", "new pass"]


def test_after_a_jump_time_goes_on_from_there():
    assert verdicts([5, 1, 0.5, 2]) == ["next", "new pass", "late", "next"]


def test_a_late_stamp_has_a_place_in_its_pass_and_does_not_turn_time_back():
    order = TimeOrder(1.0)
    assert [order.place(k * SECOND) for k in (5, 4, 6, 5, 4, 7)] == [False] * 4 + [True, False]
    order = TimeOrder(1.0)
    assert not any(order.place(k * SECOND) for k in (10, 9, 10, 9))


def passes():
    return Passes({Stream.TWIST: 1.0, Stream.FEATURES: 1.0})


def test_streams_count_their_passes_alike_whichever_jumps_first():
    for first, second in ((Stream.TWIST, Stream.FEATURES), (Stream.FEATURES, Stream.TWIST)):
        numbers = passes()
        assert [numbers.enter(first, k * SECOND) for k in (8, 9, 0, 1)] == [0, 0, 1, 1]
        assert numbers.number(second) == 1
        numbers = passes()
        numbers.enter(second, 8 * SECOND)
        assert [numbers.enter(first, k * SECOND) for k in (8, 9, 0, 1)] == [0, 0, 1, 1]
        assert [numbers.enter(second, k * SECOND) for k in (9, 0)] == [0, 1]


def test_a_stream_that_joins_later_joins_the_pass_that_the_others_are_in():
    numbers = passes()
    for k in (8, 0):
        numbers.enter(Stream.TWIST, k * SECOND)
    assert numbers.enter(Stream.FEATURES, SECOND) == 1


def test_a_refused_stamp_changes_no_pass():
    numbers = passes()
    numbers.enter(Stream.TWIST, 8 * SECOND)
    with pytest.raises(RefusedMessage) as error:
        numbers.enter(Stream.TWIST, 8 * SECOND - 1)
    assert error.value.refusal is Refusal.LATE
    assert numbers.enter(Stream.TWIST, 9 * SECOND) == 0
