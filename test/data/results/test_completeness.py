# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a run is complete, from what a player has sent and what the nodes say became of it."""

import pytest

from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags.layout import (
    FEATURES,
    IMU,
    LEFT_IMAGE,
    PREDICTION,
    RIGHT_IMAGE,
    TWIST,
)
from vislam_ros.data.results.completeness import (
    TRACKER,
    Ledger,
    NodeReport,
    describe_refused,
    lost_frames,
    shortfall,
)

SENT = {TWIST.name: 10, FEATURES.name: 10}


def imu_report(twists=10, refused=None):
    refused = refused or {}
    return NodeReport(
        received={TWIST.name: twists}, refused=refused, predictions=twists - sum(refused.values())
    )


def slam_report(features=10, predictions=10, refused=None, waiting=0):
    return NodeReport(
        received={FEATURES.name: features, PREDICTION.name: predictions},
        refused=refused or {},
        first=dict.fromkeys(refused or {}, "1.5"),
        waiting=waiting,
        refused_at_end={"features_no_prediction": waiting} if waiting else {},
        first_at_end={"features_no_prediction": "9.9"} if waiting else {},
    )


def ledger(imu=None, slam=None, sent=SENT):
    ledger = Ledger()
    ledger.set_sent(sent)
    ledger.set_report("imu_prediction_node", imu or imu_report())
    ledger.set_report("slam_node", slam or slam_report())
    return ledger


def test_a_tenth_of_the_frames_may_have_no_pose():
    assert lost_frames(9, {"features_late": 1}, {}) is None
    told = lost_frames(89, {"features_late": 4, "features_no_prediction": 6}, {})
    assert told is not None
    assert told.startswith("10% of the frames have no pose: 4 features_late (it came after")
    assert "6 features_no_prediction (no predicted motion" in told


def test_few_frames_other_streams_and_frames_that_came_twice_are_not_told():
    assert lost_frames(4, {"features_late": 3}, {}) is None
    assert lost_frames(5, {"features_late": 3}, {"features_late": "1.5"}) == (
        "38% of the frames have no pose: 3 features_late (it came after a newer one, the first at "
        "1.5 s)"
    )
    assert lost_frames(9, {"twist_late": 9, "features_duplicate": 9}, {}) is None


def test_a_step_for_each_features_message_is_complete():
    assert ledger().is_settled(steps=10)
    assert ledger().shortfall(steps=10) is None


def test_what_the_data_are_to_blame_for_leaves_a_run_complete():
    whole = ledger(
        imu_report(refused={"twist_non_finite": 1}),
        slam_report(predictions=9, refused={"features_duplicate_ids": 3}),
    )
    assert whole.is_settled(steps=7)
    assert whole.shortfall(steps=7) is None
    refused, first = whole.refused(at_end=True)
    assert refused == {"features_duplicate_ids": 3, "twist_non_finite": 1}
    assert first == {"features_duplicate_ids": "1.5"}


def test_frames_that_wait_for_a_motion_that_nobody_sent_are_refused_at_the_end():
    whole = ledger(slam=slam_report(waiting=1))
    assert whole.is_settled(steps=9)
    assert whole.shortfall(steps=9) is None
    assert whole.refused(at_end=False) == ({}, {})
    assert whole.refused(at_end=True) == (
        {"features_no_prediction": 1},
        {"features_no_prediction": "9.9"},
    )


@pytest.mark.parametrize(
    ("imu", "slam", "steps", "words"),
    [
        (None, slam_report(features=8), 8, "messages did not arrive: 2 of stereo/features; 8 "),
        (imu_report(twists=9), slam_report(predictions=9, waiting=1), 9, "1 of imu/twist; 9 step"),
        (None, slam_report(predictions=6, waiting=4), 6, "4 of prediction/odometry; 6 steps"),
        (None, None, 9, "1 of 10 features messages were not answered"),
        (
            None,
            slam_report(refused={"features_late": 10}),
            0,
            "not one step: 10 features_late (it",
        ),
        (None, slam_report(refused={"features_queue_full": 4}), 6, "refused 4 features_queue_f"),
        (None, slam_report(refused={"internal_error": 1}), 10, "1 internal_error (a node failed"),
    ],
)
def test_what_should_have_come_and_did_not_makes_it_incomplete(imu, slam, steps, words):
    lacking = ledger(imu, slam)
    assert words in lacking.shortfall(steps)


def test_a_topic_that_a_node_does_not_hear_does_not_count():
    assert ledger(sent={**SENT, IMU.name: 1000}).is_settled(steps=10)


@pytest.mark.parametrize(
    ("images", "made", "heard", "settled"),
    [
        (10, 10, 10, True),
        (10, 9, 9, True),  # a pair over again, or without its partner
        (9, 9, 9, False),  # an image is on its way to the tracker
        (10, 10, 9, False),  # features are on their way to slam_node
    ],
)
def test_features_that_a_tracker_makes_are_those_that_must_arrive(images, made, heard, settled):
    sent = {TWIST.name: 10, FEATURES.name: 0, LEFT_IMAGE.name: 10, RIGHT_IMAGE.name: 10}
    books = ledger(slam=slam_report(features=heard), sent=sent)
    received = {LEFT_IMAGE.name: images, RIGHT_IMAGE.name: 10}
    books.set_report(TRACKER, NodeReport(received=received, features=made))
    assert books.features_sent == made
    assert books.is_settled(steps=heard) is settled


def test_a_player_that_begins_anew_is_counted_anew():
    twice = ledger(slam=slam_report(refused={"features_late": 2}))
    assert twice.is_settled(steps=8)
    assert twice.set_sent({TWIST.name: 1, FEATURES.name: 1})
    assert not twice.is_settled(steps=0)
    twice.set_sent(SENT)
    twice.set_report("imu_prediction_node", imu_report(twists=20))
    twice.set_report("slam_node", slam_report(20, 20, refused={"features_late": 2}))
    assert not twice.is_settled(steps=9)
    assert twice.is_settled(steps=10)


def test_a_report_is_read_from_the_values_of_a_status():
    report = NodeReport.of_values(
        {
            "rate imu/twist [Hz]": "10.0",
            "received imu/twist": "12",
            "refused twist_late": "2",
            "first twist_late [s]": "3.5",
            "features waiting": "4",
            "at end refused features_no_prediction": "4",
            "at end first features_no_prediction [s]": "9.5",
            "predictions": "10",
        }
    )
    assert report == NodeReport(
        received={"imu/twist": 12},
        refused={"twist_late": 2},
        first={"twist_late": "3.5"},
        waiting=4,
        refused_at_end={"features_no_prediction": 4},
        first_at_end={"features_no_prediction": "9.5"},
        predictions=10,
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"received imu/twist": "many"}, "received imu/twist: 'many' is no whole number"),
        ({"refused twist_late": "nan"}, "refused twist_late: 'nan' is no whole number"),
        ({"features waiting": ""}, "features waiting: '' is no whole number"),
        ({"refused by_chance": "1"}, "'by_chance' is no reason to refuse a message"),
    ],
)
def test_a_status_of_somebody_else_is_no_report(values, words):
    with pytest.raises(RefusedMessage, match=words):
        NodeReport.of_values(values)


def test_offline_the_same_rule_holds():
    assert shortfall(5, {"features_late": 2}, {}) is None
    assert shortfall(0, {}, {}) == "not one step: there were no features"
    assert shortfall(5, {"features_queue_full": 2}, {}).startswith("refused 2 features_queue_full")


def test_refused_messages_are_told_in_one_line():
    line = describe_refused({"twist_late": 2, "imu_unpaired": 1}, {"twist_late": "7.5"})
    assert line == (
        "2 twist_late (it came after a newer one, the first at 7.5 s); "
        "1 imu_unpaired (the other stream has none with the same stamp)"
    )
