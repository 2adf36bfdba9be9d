# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faulty messages on live topics cost themselves; all kinds are tried by ``tools/faults.py``."""

from collections import Counter

import pytest
from reliability.topic_faults import STREAMS, Fault, all_faults
from reliability.topic_trials import TrialRow, measure_topic_faults

FAULTS = {(fault.stream, fault.kind): fault for fault in all_faults()}

TRIED = [
    ("features", "stamp 1 h ahead"),
    ("features", "bytes cut off"),
    ("twist", "stamp 2^31 - 1 s"),
    ("twist", "sent late"),
    ("calibration", "changed"),
    ("prediction", "stamp 1 h back"),
    ("prediction", "not sent"),
]


def test_every_stream_has_every_kind_of_stamp_and_of_arrival() -> None:
    kinds = Counter(kind for stream, kind in FAULTS if stream in STREAMS)
    everywhere = {kind for kind, n in kinds.items() if n == len(STREAMS)}
    assert len([kind for kind in everywhere if "stamp" in kind or "seconds" in kind]) == 7
    assert {"sent twice", "sent late", "not sent", "bytes cut off", "NaN"} <= everywhere


def dropped(_one: bytes, after: bytes) -> tuple[list[bytes], list[bytes]]:
    return [], [after]


UNTRUE = Fault("told otherwise", "features", dropped, ("features_late",), is_lost=False)


@pytest.fixture(scope="module")
def rows() -> dict[tuple[str, str], TrialRow]:
    """Rows of the faults that are tried here, each in a pass of its own of running graphs."""
    faults = [*(FAULTS[fault] for fault in TRIED), UNTRUE]
    return {(row.stream, row.kind): row for row in measure_topic_faults(faults)}


@pytest.mark.parametrize("fault", TRIED, ids=" ".join)
def test_a_fault_on_a_topic_costs_its_message_and_nothing_else(
    rows: dict[tuple[str, str], TrialRow], fault: tuple[str, str]
) -> None:
    row = rows[fault]
    assert row.tried >= 109
    assert (row.answered, row.same, row.others) == (row.tried, row.tried, 0)
    assert row.as_told, row.counted
    assert row.holds


def test_what_is_told_otherwise_does_not_hold(rows: dict[tuple[str, str], TrialRow]) -> None:
    row = rows[UNTRUE.stream, UNTRUE.kind]
    assert (row.tried, row.answered, row.same) == (110, 109, 60)
    assert not row.as_told
    assert not row.holds
