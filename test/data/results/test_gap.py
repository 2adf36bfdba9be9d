# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a recording is complete whose extent no player tells."""

import pytest

from vislam_ros.data.bags.layout import FEATURES
from vislam_ros.data.results.completeness import Ledger, NodeReport, RecordedSteps


def recorded(*numbers):
    steps = RecordedSteps()
    for number in numbers:
        steps.add(number, number)
    return steps


def ledger_of(report, *, joined=None):
    ledger = Ledger()
    if joined is not None:
        ledger.set_report("slam_node", joined)
        ledger.join()
    ledger.set_report("slam_node", report)
    return ledger


def report(features=10, steps=10, refused=None, waiting=0):
    refused = refused or {}
    return NodeReport(
        received={FEATURES.name: features},
        refused=refused,
        first=dict.fromkeys(refused, "1.5"),
        waiting=waiting,
        refused_at_end={"features_no_prediction": waiting} if waiting else {},
        first_at_end={"features_no_prediction": "9.9"} if waiting else {},
        steps=steps,
    )


WHOLE = recorded(*range(1, 11))


@pytest.mark.parametrize("to_the_end", [True, False])
def test_all_steps_that_were_numbered_are_complete(to_the_end):
    assert ledger_of(report()).gap(WHOLE, to_the_end=to_the_end) is None


def test_a_recording_that_begins_late_is_complete_from_there_on():
    assert ledger_of(report()).gap(recorded(7, 8, 9, 10), to_the_end=True) is None


def test_numbers_begin_anew_with_a_new_slam_node():
    steps = recorded(1, 2, 3, 1, 2)
    assert (steps.count, steps.missing, steps.last) == (5, 0, 2)
    assert ledger_of(report(features=2, steps=2)).gap(steps, to_the_end=True) is None


@pytest.mark.parametrize(
    ("numbers", "to_the_end", "reason"),
    [
        ((1, 2, 4, 8), False, "4 of 8 steps did not arrive"),
        ((7, 8, 9), True, "1 of 4 steps did not arrive"),
        ((7, 8, 9), False, None),
        ((1, 2, 4, 8), True, "6 of 10 steps did not arrive"),
    ],
)
def test_steps_that_did_not_arrive_are_counted(numbers, to_the_end, reason):
    assert ledger_of(report()).gap(recorded(*numbers), to_the_end=to_the_end) == reason


def test_features_that_came_to_nothing_are_a_gap_and_those_that_wait_or_are_refused_are_none():
    whole = report(features=15, refused={"features_late": 2}, waiting=3)
    assert ledger_of(whole).gap(WHOLE, to_the_end=True) is None
    lacking = report(features=16, refused={"features_late": 2}, waiting=3)
    expected = "1 features messages were not answered"
    assert ledger_of(lacking).gap(WHOLE, to_the_end=True) == expected


def test_faults_of_the_run_are_a_gap():
    faulty = report(features=11, refused={"features_queue_full": 1})
    reason = ledger_of(faulty).gap(WHOLE, to_the_end=True)
    assert reason.startswith("refused 1 features_queue_full (")


def test_what_was_before_a_recording_that_begins_late_is_not_counted():
    before = report(features=106, steps=100, refused={"features_queue_full": 4})
    ledger = ledger_of(
        report(features=112, steps=105, refused={"features_queue_full": 4, "features_late": 1}),
        joined=before,
    )
    assert ledger.gap(recorded(*range(101, 106)), to_the_end=True) is None
    assert ledger.refused(at_end=False) == ({"features_late": 1}, {"features_late": "1.5"})


def test_a_first_report_after_the_beginning_is_what_was_before():
    ledger = Ledger()
    ledger.join()
    ledger.set_report("slam_node", report(refused={"features_queue_full": 4}))
    assert ledger.refused(at_end=False) == ({}, {})


def test_without_a_step_or_a_report_there_is_a_reason():
    assert "not one step" in ledger_of(report(0, 0)).gap(RecordedSteps(), to_the_end=False)
    before = ledger_of(report(10, 10, {"features_queue_full": 1}))
    reason = before.gap(RecordedSteps(), to_the_end=False)
    assert reason == "not one step: slam_node had published its 10 before"
    assert Ledger().gap(WHOLE, to_the_end=True) == "slam_node has told nothing of itself"


def test_a_step_is_known_again_until_the_next_pass_begins():
    steps = recorded(1, 2, 3)
    assert steps.has(3, 3)
    assert steps.has(2, 2)
    assert not steps.has(3, 4)
    steps.add(1, 1, first_of_pass=True)
    assert not steps.has(3, 3)
