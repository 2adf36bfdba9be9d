# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stereo camera from its three messages, in whatever order they come."""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest
from rewriting import STORE, rewritten

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration, differences
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, EXTRINSICS, LEFT_CAMERA, RIGHT_CAMERA
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.bags.writer import write_bag


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


def test_a_right_camera_of_its_own_has_its_pixels_mapped(parts, small_drive):
    calibration = Calibration(DEFAULT_FRAMES)
    for topic in CALIBRATION_TOPICS:
        calibration.add(topic, parts[topic])
    assert calibration.rectification is None
    right = parts[RIGHT_CAMERA]
    moved = changed(right, 2, right.p[2] + 3.0)
    assert calibration.add(RIGHT_CAMERA, moved) == small_drive.camera
    assert calibration.rectification is not None
    pixels = small_drive.pixels.astype(float)
    np.testing.assert_allclose(
        calibration.rectification.pixels(pixels) - pixels, [[0, 0, -3, 0]] * len(pixels), atol=1e-9
    )
    assert not calibration.add(RIGHT_CAMERA, moved)
    assert differences(small_drive.camera, small_drive.camera) == "intrinsics of the right camera"


def test_a_longer_focal_length_keeps_the_baseline(parts, small_drive):
    calibration = Calibration(DEFAULT_FRAMES)
    right = parts[RIGHT_CAMERA]
    longer = changed(right, [0, 3], 1.01 * right.p[[0, 3]])
    for topic, message in {**parts, RIGHT_CAMERA: longer}.items():
        calibration.add(topic, message)
    assert calibration.camera is not None
    assert calibration.camera.baseline == pytest.approx(small_drive.camera.baseline, rel=1e-14)
    assert calibration.camera.fx == small_drive.camera.fx


def test_a_right_camera_that_stands_higher_turns_both(parts, small_drive):
    calibration = Calibration(DEFAULT_FRAMES)
    camera, right = small_drive.camera, parts[RIGHT_CAMERA]
    # The camera at c has P = K [I | -c]; up is negative.
    rise = 0.1 * camera.baseline
    for topic, message in {**parts, RIGHT_CAMERA: changed(right, 7, camera.fy * rise)}.items():
        calibration.add(topic, message)
    turned = calibration.camera
    assert turned is not None
    assert turned.baseline == pytest.approx(np.hypot(camera.baseline, rise))
    x_axis = (camera.T_camera_body @ turned.T_body_camera)[:3, 0]
    np.testing.assert_allclose(x_axis, np.array([10.0, -1.0, 0.0]) / np.sqrt(101.0), atol=1e-12)
    assert turned.position_body_camera == camera.position_body_camera


def test_a_bag_whose_right_camera_is_its_own_is_the_drive_of_the_rectified_pair(
    small_drive, tmp_path
):
    camera = small_drive.camera
    own = small_drive.pixels.astype(float)
    own[:, 2] = (own[:, 2] - camera.cx) * 1.01 + camera.cx + 2.0
    write_bag(replace(small_drive, pixels=own.astype(np.float32)), tmp_path / "bag")

    def change(topic, _, message):
        if topic != RIGHT_CAMERA.recorded:
            return message
        message = changed(message, [0, 3], 1.01 * message.p[[0, 3]])
        return changed(message, 2, camera.cx + 2.0)

    (drive,) = read_passes(rewritten(tmp_path / "bag", change))
    np.testing.assert_allclose(drive.pixels, small_drive.pixels, atol=2e-4)
    assert drive.camera.baseline == pytest.approx(camera.baseline, rel=1e-14)
    np.testing.assert_array_equal(drive.ids, small_drive.ids)


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
