# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a stamp is believed, late, there twice, or the first of a new pass, live and offline."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vislam_ros.core.tracking.refusals import Stream
from vislam_ros.core.tracking.time_order import Passes, TimeOrder

SECOND = 1_000_000_000


def ns(seconds):
    return round(seconds * SECOND)


def fates(stamps, **how):
    """What becomes of stamps in seconds that come one after the other, and what is held at last.

    Each with its place among them: the believed ones, ``new pass`` where one begins with it, and
    the refused ones by reason.
    """
    told = {}
    place = {}
    order = TimeOrder(1.0, lambda refusal, _: told.update({place["now"]: refusal.word}), **how)
    keys = [f"{k}" for k in range(len(stamps))]
    for key, seconds in zip(keys, stamps, strict=True):
        place["now"] = key
        for believed in order.enter(ns(seconds), key):
            told[believed.message] = "new pass" if believed.begins_pass else "believed"
    return told, [stamp / SECOND for stamp in order.held]


def passes_of(stamps, **how):
    """Stamps (s) that are believed, pass by pass, in their order, and the words of the others."""
    passes, refused = [[]], []
    order = TimeOrder(1.0, lambda refusal, stamp: refused.append((refusal.word, stamp)), **how)
    for seconds in stamps:
        for believed in order.enter(ns(seconds), seconds):
            if believed.begins_pass:
                passes.append([])
            passes[-1].append(believed.message)
    order.end()
    return passes, [(word, stamp / SECOND) for word, stamp in refused]


STREAM = [20.0 + 0.1 * k for k in range(12)]


def test_only_what_is_newer_is_believed_and_the_first_with_the_second():
    told, held = fates([5, 5.5, 5.5, 5.2, 6])
    assert list(told.values()) == ["believed", "believed", "duplicate", "late", "believed"]
    assert not held
    assert fates([5]) == ({}, [5.0])


def test_offline_the_late_one_is_used_too():
    assert passes_of([5, 5.5, 5.2, 6], sorts=True) == ([[5, 5.5, 5.2, 6]], [])


BAD = [0.0, -5.0, 18.9, 20 - 3600.0, 22.2, 20 + 3600.0, 2.0**31 - 1]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("place", range(13))
@pytest.mark.parametrize("replaces", [False, True])
def test_a_bad_stamp_costs_nothing_but_itself_wherever_it_comes(bad, place, replaces):
    before, after = STREAM[:place], STREAM[place + replaces :]
    for sorts in (False, True):
        expected = ([[*before, *after]], [("bad_stamp", bad)])
        assert passes_of([*before, bad, *after], sorts=sorts) == expected


@pytest.mark.parametrize(("one", "other"), itertools.permutations(BAD, 2))
def test_neither_do_two_that_follow_each_other(one, other):
    passes, refused = passes_of([*STREAM[:6], one, other, *STREAM[6:]])
    assert (passes, len(refused)) == ([STREAM], 2)


def test_after_a_hole_the_stream_goes_on_also_where_a_bad_stamp_stands_at_its_end():
    later = [50.0, 50.1, 50.2]
    year = [3e7 + k for k in STREAM]
    assert passes_of([*STREAM, *later, *year]) == ([[*STREAM, *later, *year]], [])
    for bad in (0.0, 3600.0):
        for place in range(4):
            spoilt = [*STREAM, *later[:place], bad, *later[place:]]
            assert passes_of(spoilt) == ([[*STREAM, *later]], [("bad_stamp", bad)])


def test_a_lone_message_in_a_hole_is_believed_with_what_comes_after_the_hole():
    assert passes_of([*STREAM, 25, 31, 40, 40.1]) == ([[*STREAM, 25, 31, 40, 40.1]], [])


def test_what_nothing_follows_up_is_refused_at_the_end():
    assert passes_of([*STREAM, 50]) == ([STREAM], [("bad_stamp", 50)])
    assert passes_of([7, 7, 7]) == ([[]], [("duplicate", 7), ("duplicate", 7), ("bad_stamp", 7)])


def test_time_may_begin_anew_and_no_message_is_lost_to_it():
    for again in (STREAM, [k - 3600 for k in STREAM], [k - 5 for k in STREAM]):
        assert passes_of([*STREAM, *again]) == ([STREAM, again], [])
    for bad in BAD:
        spoilt = [*STREAM, bad, *STREAM[:3], bad, *STREAM[3:]]
        assert passes_of(spoilt) == ([STREAM, STREAM], [("bad_stamp", bad)] * 2)


def test_a_stamp_exactly_the_jump_back_is_late_and_one_before_it_may_begin_a_pass():
    assert passes_of([*STREAM, STREAM[-1] - 1, STREAM[-1] + 0.1])[1] == [("late", 20.1)]
    begun = [STREAM[-1] - 1.001, STREAM[-1] - 0.9]
    assert passes_of([*STREAM, *begun]) == ([STREAM, begun], [])


@given(
    st.lists(st.floats(0.51, 1.0), min_size=3, max_size=30),
    st.floats(0.01, 60.0),
    st.booleans(),
)
def test_a_stream_of_any_rate_is_believed_whole(steps, scale, sorts):
    stamps, now = [], 1e6
    for step in steps:
        stamps.append(now)
        now += scale * step
    assert passes_of(stamps, sorts=sorts) == ([stamps], [])


def test_a_slow_stream_survives_a_bad_stamp():
    slow = [3.0 * k for k in range(20, 30)]
    for place in range(10):
        for bad in (0.0, 1e4):
            spoilt = [*slow[:place], bad, *slow[place:]]
            assert passes_of(spoilt) == ([slow], [("bad_stamp", bad)])


def test_a_stream_without_any_order_does_not_fill_the_memory():
    refused = []
    order = TimeOrder(1.0, lambda *why: refused.append(why))
    for k in range(100):
        assert order.enter(ns(1e6 / (1 + k)), k) == []
    assert len(order.held) + len(refused) == 100
    assert len(order.held) < 10


def passes():
    refused = []
    return Passes({Stream.TWIST: 1.0, Stream.FEATURES: 1.0}, lambda *why: refused.append(why))


def numbers_of(passes, stream, stamps):
    """Numbers of the passes of stamps (s) that come one after the other."""
    entered = [told for seconds in stamps for told in passes.enter(stream, ns(seconds), None)]
    return [number for number, *_ in entered]


def test_streams_count_their_passes_alike_whichever_jumps_first():
    for first, second in ((Stream.TWIST, Stream.FEATURES), (Stream.FEATURES, Stream.TWIST)):
        numbers = passes()
        assert numbers_of(numbers, first, [8, 9, 0, 1]) == [0, 0, 1, 1]
        assert numbers.number(second) == 1
        numbers = passes()
        assert numbers_of(numbers, second, [8, 9]) == [0, 0]
        assert numbers_of(numbers, first, [8, 9, 0, 1]) == [0, 0, 1, 1]
        assert numbers_of(numbers, second, [10, 0, 1]) == [0, 1, 1]


def test_a_stream_that_joins_later_joins_the_pass_that_the_others_are_in():
    numbers = passes()
    numbers_of(numbers, Stream.TWIST, [8, 9, 0, 1])
    assert numbers_of(numbers, Stream.FEATURES, [1, 2]) == [1, 1]


def test_what_is_held_is_told_by_stream_and_refused_at_the_end():
    refused = []
    numbers = Passes({Stream.TWIST: 1.0, Stream.FEATURES: 1.0}, lambda *why: refused.append(why))
    numbers_of(numbers, Stream.TWIST, [8, 9, 70])
    assert numbers.held(Stream.TWIST) == [70 * SECOND]
    over = numbers.refused_if_over()
    assert over.counts == {"twist_bad_stamp": 1}
    assert over.first_stamps == {"twist_bad_stamp": 70 * SECOND}
    numbers.end()
    assert [(stream, reason.word) for stream, reason, _ in refused] == [
        (Stream.TWIST, "bad_stamp")
    ]
