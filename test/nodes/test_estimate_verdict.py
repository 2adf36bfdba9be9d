# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the estimate can be trusted, as the SLAM node says it while it runs."""

import copy

from vislam_ros.data.bags.layout import DIAGNOSTICS, LANDMARKS, ODOMETRY
from vislam_ros.nodes import conversions
from vislam_ros.nodes.slam_node import SlamNode
from vislam_ros.nodes.slam_report import PREVIOUS, verdict_from_values

WELL, WARN = b"\x00", b"\x01"


def values_of(message):
    return conversions.status_values(message, "/slam_node")


def give_all(node, drive):
    for prediction in drive.predictions:
        node.on_prediction(prediction)
    for features in drive.features:
        node.on_features(features)


def at(message, stamp):
    """Return the same message with another stamp (ns)."""
    result = copy.deepcopy(message)
    result.header.stamp = conversions.stamp_to_message(stamp)
    return result


def test_the_verdict_on_a_pass_goes_out_before_its_map_when_the_next_one_begins(
    make_node, capture, drive
):
    node = make_node(SlamNode)
    order, published = [], capture(node)
    keep = node.monitor.publish

    def noted(publisher, message):
        order.append(publisher.topic_name)
        keep(publisher, message)

    node.monitor.publish = noted
    drive.calibrate(node)
    give_all(node, drive)
    verdict, already = node.core.verdict(), len(order)
    give_all(node, drive)
    beginning = order[already:]
    assert beginning.index(DIAGNOSTICS.recorded) < beginning.index(LANDMARKS.recorded)
    told = [verdict_from_values(values_of(m), PREVIOUS) for m in published[DIAGNOSTICS.recorded]]
    assert told[-1] == verdict
    assert verdict.stamp == drive.stamps[-1]


def test_diagnostics_warn_while_vision_is_missing_and_are_well_when_it_is_back(
    make_node, capture, drive
):
    node = make_node(SlamNode)
    published = capture(node)

    def reported():
        node.monitor.report()
        return published[DIAGNOSTICS.recorded][-1]

    drive.calibrate(node)
    for prediction in drive.predictions:
        node.on_prediction(prediction)
    for features in drive.features[:6]:
        node.on_features(features)
    assert reported().status[0].level == WELL

    late = drive.stamps[5] + 4_000_000_000
    node.on_prediction(at(drive.predictions[-1], late))
    status = reported().status[0]
    assert status.level == WARN
    assert status.message.startswith(
        "running; doubtful: vision was missing for 4.0 s, 0.5 s after"
    )

    node.on_prediction(at(drive.predictions[-1], late + 200_000_000))
    for k in range(3):
        node.on_features(at(drive.features[6 + k], late + k * 100_000_000))
    assert len(published[ODOMETRY.recorded]) == 9
    message = reported()
    assert (message.status[0].level, message.status[0].message) == (WELL, "running")
    # That it was missing remains true of the drive.
    assert values_of(message)["verdict"] == "doubtful"
    assert "4.0 s" in values_of(message)["verdict reason 1"]
