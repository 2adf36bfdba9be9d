# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stereo camera from its three messages, in whatever order they come."""

import copy
import itertools
from dataclasses import replace

import pytest
from rewriting import STORE

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration, differences
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, EXTRINSICS, LEFT_CAMERA, RIGHT_CAMERA


@pytest.fixture
def parts(bag):
    """The three messages, by topic."""
    by_name = {topic.recorded: topic for topic in CALIBRATION_TOPICS}
    with BagMessages(bag) as messages:
        return {
            by_name[item.topic]: STORE.deserialize_cdr(bytes(data), item.msgtype)
            for item, _, data in messages.messages(by_name)
        }


def changed(info, place, value):
    info = copy.deepcopy(info)
    info.p = info.p.copy()
    info.p[place] = value
    return info


@pytest.mark.parametrize("order", list(itertools.permutations(CALIBRATION_TOPICS)))
def test_the_camera_is_there_with_the_last_of_the_three(parts, small_drive, order):
    calibration = Calibration(DEFAULT_FRAMES)
    for k, topic in enumerate(order):
        assert calibration.camera is None
        assert calibration.missing() == [t.name for t in CALIBRATION_TOPICS if t in order[k:]]
        camera = calibration.add(topic, parts[topic])
        assert camera == (small_drive.camera if k == 2 else None)
    assert calibration.camera == small_drive.camera
    assert calibration.image_size == small_drive.image_size
    assert not calibration.missing()


def test_a_message_that_says_the_same_again_changes_nothing(parts):
    calibration = Calibration(DEFAULT_FRAMES)
    for topic in CALIBRATION_TOPICS:
        calibration.add(topic, parts[topic])
    assert not any(calibration.add(topic, parts[topic]) for topic in CALIBRATION_TOPICS)


def test_a_change_is_told_by_name_with_both_values(small_drive):
    camera = small_drive.camera
    assert differences(camera, replace(camera, cx=1.5, fx_baseline=2.5)) == (
        f"cx: {camera.cx} to 1.5, fx_baseline: {camera.fx_baseline} to 2.5"
    )


@pytest.mark.parametrize("difference", [1e-9, 9e-4])
def test_projections_that_differ_by_a_rounding_are_a_pair(parts, small_drive, difference):
    calibration = Calibration(DEFAULT_FRAMES)
    right = parts[RIGHT_CAMERA]
    parts[RIGHT_CAMERA] = changed(right, 2, right.p[2] + difference)
    for topic in CALIBRATION_TOPICS:
        calibration.add(topic, parts[topic])
    assert calibration.camera == small_drive.camera


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (3, 0.0, "field p[3] of the right camera is 0.0: it must be -fx times the baseline"),
        (7, 1e6, "field p: the right camera lies at"),
    ],
)
def test_camera_infos_that_are_no_pair_are_refused_until_one_comes_that_is(
    parts, small_drive, place, value, words
):
    calibration = Calibration(DEFAULT_FRAMES)
    calibration.add(LEFT_CAMERA, parts[LEFT_CAMERA])
    with pytest.raises(RefusedMessage) as error:
        calibration.add(RIGHT_CAMERA, changed(parts[RIGHT_CAMERA], place, value))
    assert error.value.refusal is Refusal.NOT_A_PAIR
    assert words in str(error.value)
    assert not calibration.add(EXTRINSICS, parts[EXTRINSICS])
    assert calibration.camera is None
    assert calibration.add(RIGHT_CAMERA, parts[RIGHT_CAMERA])
    assert calibration.camera == small_drive.camera
    with pytest.raises(RefusedMessage):
        calibration.add(RIGHT_CAMERA, changed(parts[RIGHT_CAMERA], place, value))
    assert calibration.camera == small_drive.camera
