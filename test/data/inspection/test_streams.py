# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults of stamps, each alone."""

import numpy as np
import pytest
from numpy.typing import NDArray

from vislam_ros.data.datasets.mending import mended_stamps
from vislam_ros.data.inspection.streams import Stream, judge_stamps

START = 1_700_000_000_000_000_000
EVEN = START + np.arange(100) * 100_000_000


def judged(stamps: NDArray[np.int64]) -> str:
    finding = judge_stamps([Stream.of("frames", stamps)])
    return "" if finding is None else finding.words


def jittered(std: float) -> NDArray[np.int64]:
    noise = np.random.default_rng(1).normal(0.0, std, len(EVEN))
    return EVEN + (noise * 1e8).astype(np.int64)


def test_even_stamps_have_no_fault() -> None:
    assert judged(EVEN) == ""
    assert judged(jittered(0.02)) == ""
    assert Stream.of("frames", EVEN).rate == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (np.delete(EVEN, [40]), "gaps in frames: 1, of 0.1 s at most"),
        (np.where(np.arange(100) == 7, 0, EVEN), "1 of 100 stamps of frames are zero"),
        (np.insert(EVEN, 5, EVEN[5]), "1 stamps of frames repeat another"),
        (EVEN[[*range(50), 51, 50, *range(52, 100)]], "1 of 100 frames come up to 0.1 s after"),
        (jittered(0.2), "steps of frames scatter"),
    ],
)
def test_each_fault_is_told(stamps: NDArray[np.int64], words: str) -> None:
    assert words in judged(stamps)


def test_what_reading_lives_with_is_told_from_what_it_does_not() -> None:
    for stamps, is_repaired in ((np.delete(EVEN, [40]), True), (jittered(0.2), False)):
        finding = judge_stamps([Stream.of("frames", stamps)])
        assert finding is not None
        assert finding.is_repaired is is_repaired


def test_few_stamps_have_no_rate_and_no_fault() -> None:
    for count in range(3):
        assert judged(EVEN[:count]) == ""


def test_stamps_in_wrong_rows_are_put_between_their_neighbours() -> None:
    shuffled = EVEN.copy()
    shuffled[[20, 60]] = shuffled[[60, 20]]
    mended, finding = mended_stamps(shuffled)
    np.testing.assert_allclose(mended - START, EVEN - START, atol=1000)
    assert finding is not None
    assert finding.numbers["rows"] == [20, 60]
    assert not finding.is_repaired
    assert mended_stamps(EVEN)[1] is None


def test_the_first_and_the_last_row_may_be_wrong() -> None:
    wrong = EVEN.copy()
    wrong[0], wrong[-1] = EVEN[50], 0
    mended, _ = mended_stamps(wrong)
    np.testing.assert_allclose(mended - START, EVEN - START, atol=1000)
