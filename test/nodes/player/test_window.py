# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which feature frames count as answered."""

import threading

import pytest

from vislam_ros.nodes.player.window import FeatureWindow


class CountedCondition(threading.Condition):
    """A condition that counts how often it wakes who waits."""

    def __init__(self):
        super().__init__()
        self.notified = 0

    def notify_all(self):
        self.notified += 1
        super().notify_all()


@pytest.fixture
def condition():
    return CountedCondition()


@pytest.fixture
def window(condition):
    window = FeatureWindow(condition)
    for stamp in (10, 20, 30):
        window.add(stamp)
    return window


def test_an_answer_counts_for_its_own_frame(window):
    window.acknowledge(10)
    assert (window.sent, window.acknowledged, window.waiting) == (3, 1, 2)


def test_an_answer_counts_for_the_refused_frames_before_it(window):
    window.acknowledge(30)
    assert (window.acknowledged, window.waiting) == (3, 0)


def test_a_stamp_from_before_the_window_counts_for_nothing(window):
    window.acknowledge(5)
    assert (window.acknowledged, window.waiting) == (0, 3)


def test_a_frame_that_came_late_is_answered_with_the_one_before_it(window):
    window.add(15)
    window.acknowledge(30)
    assert window.waiting == 0


def test_after_a_stall_answers_are_expected_again_with_the_next_one(window):
    window.expect_none()
    assert (window.waiting, window.answered) == (0, False)
    window.add(40)
    window.acknowledge(40)
    assert window.answered
    assert (window.sent, window.acknowledged) == (4, 1)


def test_frames_that_the_graph_refused_are_no_longer_waited_for(window):
    window.settle(taken=3, waiting=1)
    assert (window.acknowledged, window.waiting) == (2, 1)
    window.add(40)
    window.settle(taken=3, waiting=1)
    assert window.waiting == 2


def test_an_answer_from_a_new_pass_counts_for_what_was_left_of_the_old_one(window):
    window.add(1)
    window.add(2)
    window.acknowledge(1)
    assert (window.acknowledged, window.waiting) == (4, 1)


def test_a_frame_without_a_stamp_holds_nobody_up(window):
    window.add(None)
    window.add(40)
    window.acknowledge(40)
    assert window.waiting == 0


def test_nobody_is_woken_before_enough_is_answered(window, condition):
    window.enough = 1
    window.acknowledge(10)
    assert condition.notified == 0
    window.acknowledge(20)
    assert condition.notified == 1


def test_what_the_graph_says_of_itself_wakes_who_waits(window, condition):
    window.settle(taken=1, waiting=1)
    assert condition.notified == 1


def test_an_answer_and_what_the_graph_says_are_progress(window):
    seen = [window.progress]
    window.acknowledge(10)
    seen.append(window.progress)
    window.settle(taken=2, waiting=1)
    seen.append(window.progress)
    assert len(set(seen)) == 3
