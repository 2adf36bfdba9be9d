# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of reasons: one word each, from which the reason is found again."""

import pytest

from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, Stream, refusal_of


@pytest.mark.parametrize("refusal", Refusal)
def test_a_reason_is_found_by_its_word_whatever_stream_it_is_counted_for(refusal):
    assert refusal_of(refusal.word) is refusal
    for stream in Stream:
        counts = RefusalCounts()
        counts.add(stream, refusal)
        (word,) = counts.counts
        assert refusal_of(word) is refusal


def test_a_word_that_is_none_of_the_table_has_no_reason():
    with pytest.raises(ValueError, match="'odd' is no reason"):
        refusal_of("odd")


def test_the_first_stamp_of_each_reason_is_kept():
    counts, later = RefusalCounts(), RefusalCounts()
    counts.add(Stream.TWIST, Refusal.LATE, 5)
    counts.add(Stream.TWIST, Refusal.LATE, 3)
    later.add(Stream.TWIST, Refusal.LATE, 9)
    later.add(Stream.FEATURES, Refusal.LATE, 7)
    later.add(Stream.FEATURES, Refusal.UNDECODABLE)
    counts.merge(later)
    assert counts.counts == {"twist_late": 3, "features_late": 1, "features_undecodable": 1}
    assert counts.first_stamps == {"twist_late": 5, "features_late": 7}
