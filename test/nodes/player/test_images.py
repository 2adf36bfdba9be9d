# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bag of images is played as one of features is: whole, and no faster than it is taken."""

import dataclasses

import pytest
from imagery.folders import FRAMES, write_asl
from live.listening import FULL_SPEED, recorded, wait_until

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.layout import IMU, LEFT_IMAGE, RIGHT_IMAGE
from vislam_ros.data.conversion import convert


@pytest.fixture(scope="module")
def image_bag_path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    convert(write_asl(folder / "V1_01"), folder / "bag")
    return folder / "bag"


@pytest.fixture
def image_bag(image_bag_path):
    with BagMessages(image_bag_path) as bag:
        yield bag


def test_images_arrive_byte_for_byte_and_are_counted(listen, make_player, image_bag):
    listener = listen(topics=(LEFT_IMAGE, RIGHT_IMAGE, IMU))
    report = make_player(dataclasses.replace(FULL_SPEED, rate=10.0), image_bag).play()
    assert (report.state, report.delivered) == ("finished", True)
    for topic in (LEFT_IMAGE, RIGHT_IMAGE, IMU):
        sent, heard = recorded(image_bag, topic.recorded), listener.heard[topic.recorded]
        wait_until(lambda h=heard, s=sent: len(h) >= len(s), f"all of {topic.name}")
        assert heard == sent
    wait_until(lambda: listener.states[-1]["state"] == "finished", "the last status")
    assert listener.states[-1]["sent stereo/left/image_raw"] == str(FRAMES)
    assert listener.states[-1]["sent stereo/features"] == "0"


@pytest.mark.parametrize("window", [2, 4])
def test_at_full_speed_only_a_window_of_images_is_ahead_of_the_answers(
    listen, make_player, image_bag, window
):
    listener = listen(topics=(RIGHT_IMAGE, IMU))
    listener.answer_features(every=window, topic=LEFT_IMAGE)
    options = dataclasses.replace(FULL_SPEED, window=window)
    assert make_player(options, image_bag).play().state == "finished"
    assert len(listener.ahead) == FRAMES
    assert max(listener.ahead) == window


def test_a_step_ends_with_a_left_image(listen, make_player, play_in_thread, image_bag):
    listener = listen(topics=(LEFT_IMAGE, RIGHT_IMAGE, IMU))
    node = make_player(dataclasses.replace(FULL_SPEED, start_paused=True), image_bag)
    play_in_thread(node)
    lefts, rights = (listener.heard[t.recorded] for t in (LEFT_IMAGE, RIGHT_IMAGE))
    wait_until(lambda: listener.states, "the first status")
    for count in (1, 2):
        node.step()
        wait_until(lambda c=count: len(lefts) == c, "a left image")
    assert len(rights) <= 1
