# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from vislam_ros.core.tracking.stamp_pairs import StampPairs


@pytest.fixture
def unpaired():
    """Stream and stamp of each value that was given up."""
    return []


@pytest.fixture
def pairs(unpaired):
    return StampPairs(lambda stream, stamp: unpaired.append((stream, stamp)))


def test_pairs_come_out_whichever_stream_is_first(pairs, unpaired):
    assert pairs.add(0, 1, "a") is None
    assert pairs.add(1, 1, "b") == ("a", "b")
    assert pairs.add(1, 2, "d") is None
    assert pairs.add(0, 2, "c") == ("c", "d")
    assert not unpaired


def test_values_whose_partner_was_lost_are_given_up(pairs, unpaired):
    pairs.add(0, 1, "lost")
    pairs.add(0, 2, "lost too")
    pairs.add(0, 3, "a")
    pairs.add(0, 4, "b")
    assert pairs.add(1, 3, "A") == ("a", "A")
    assert pairs.add(1, 4, "B") == ("b", "B")
    assert unpaired == [(0, 1), (0, 2)]


def test_what_waits_before_a_pair_in_its_own_stream_is_given_up(pairs, unpaired):
    pairs.add(0, 3, "lost")
    pairs.add(1, 5, "A")
    assert pairs.add(0, 5, "a") == ("a", "A")
    assert unpaired == [(0, 3)]


def test_time_may_start_again(pairs):
    pairs.add(0, 9, "a")
    assert pairs.add(1, 9, "A") == ("a", "A")
    pairs.add(0, 1, "b")
    assert pairs.add(1, 1, "B") == ("b", "B")


def test_waiting_values_are_bounded(pairs, unpaired):
    for stamp in range(5000):
        pairs.add(0, stamp, None)
    assert unpaired == [(0, stamp) for stamp in range(4000)]


def test_a_value_is_left_when_the_other_stream_has_gone_past_its_stamp(pairs):
    pairs.add(0, 3, "a")
    pairs.add(1, 2, "B")
    assert (pairs.is_left(0), pairs.is_left(1)) == (False, True)
    pairs.add(1, 4, "D")
    assert pairs.is_left(0)
    pairs.add(0, 4, "d")
    assert (pairs.is_left(0), pairs.is_left(1)) == (False, False)
