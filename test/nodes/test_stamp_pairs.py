# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from vislam_ros.nodes.stamp_pairs import StampPairs


def test_pairs_come_out_whichever_stream_is_first() -> None:
    pairs = StampPairs()
    assert pairs.add(0, 1, "a") is None
    assert pairs.add(1, 1, "b") == ("a", "b")
    assert pairs.add(1, 2, "d") is None
    assert pairs.add(0, 2, "c") == ("c", "d")
    assert pairs.unpaired == 0


def test_values_whose_partner_was_lost_are_given_up() -> None:
    pairs = StampPairs()
    pairs.add(0, 1, "lost")
    pairs.add(0, 2, "lost too")
    pairs.add(0, 3, "a")
    pairs.add(0, 4, "b")
    assert pairs.add(1, 3, "A") == ("a", "A")
    assert pairs.add(1, 4, "B") == ("b", "B")
    assert pairs.unpaired == 2


def test_time_may_start_again() -> None:
    pairs = StampPairs()
    pairs.add(0, 9, "a")
    assert pairs.add(1, 9, "A") == ("a", "A")
    pairs.add(0, 1, "b")
    assert pairs.add(1, 1, "B") == ("b", "B")


def test_waiting_values_are_bounded() -> None:
    pairs = StampPairs()
    for stamp in range(5000):
        pairs.add(0, stamp, None)
    assert pairs.unpaired == 4000
