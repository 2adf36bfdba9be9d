# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Within a pass only the stamps count; the order in the bag decides where passes begin."""

from copy import deepcopy

import numpy as np
import pytest
from faulty_bags import BAD_STAMPS
from rewriting import (
    as_foreign,
    assert_same,
    changing,
    edit,
    from_half_on_anew,
    rewritten,
    the_drive,
    unchanged,
)

from vislam_ros.data.bags.layout import FEATURES, GROUND_TRUTH, TWIST
from vislam_ros.data.bags.reader import ReadingRules, read_passes
from vislam_ros.errors import VislamError

SECOND = 1_000_000_000


def after(first, second):
    """Return both changes, one after the other."""
    return lambda topic, index, message: second(topic, index, first(topic, index, message))


def test_what_the_log_has_shuffled_is_sorted(bag, small_drive):
    rng = np.random.default_rng(4)

    def later(topic, _index, time):
        return time + int(rng.uniform(0, 0.3) * SECOND) * (topic in moved)

    moved = {topic.recorded for topic in (TWIST, FEATURES, GROUND_TRUTH)}
    foreign = rewritten(bag, unchanged, log_time=later)
    assert_same(the_drive(foreign), as_foreign(small_drive))


def test_of_equal_stamps_the_first_to_come_is_used(bag, small_drive):
    def repeat(topic, index, message):
        if topic == TWIST.recorded and index == 7:
            later = deepcopy(message)
            later.twist.twist.linear.x = 99.0
            return [message, later]
        return message

    drive = the_drive(rewritten(bag, repeat))
    assert_same(drive.twists, small_drive.twists)
    assert drive.refused.counts == {"twist_duplicate": 1}
    stamp = int(small_drive.twist_stamps[7])
    assert drive.refused.first_stamps == {"twist_duplicate": stamp}


@pytest.mark.parametrize("topic", [TWIST, FEATURES], ids=["twist", "features"])
def test_a_bad_stamp_is_as_if_its_message_were_not_there(bag, topic):
    bad = dict(zip((0, 7, 30, 90), BAD_STAMPS.values(), strict=True))
    anew = from_half_on_anew(bag)

    def spoil(index, message):
        if index in bad:
            bad[index][0](message)
        return message

    def lose(index, message):
        return None if index in bad else message

    foreign, without = (
        read_passes(rewritten(bag, after(anew, changing(topic, change)), called=name))
        for name, change in (("foreign", spoil), ("less", lose))
    )
    assert len(foreign) == len(without) == 2
    for drive, other in zip(foreign, without, strict=True):
        for name in ("twist_stamps", "twists", "feature_stamps", "offsets", "ids", "pixels"):
            assert_same(getattr(drive, name), getattr(other, name))
    refused = foreign[0].refused.counts + foreign[1].refused.counts
    stream = topic.stream.value
    assert refused == {f"{stream}_bad_stamp": 3, f"{stream}_bad_fields": 1}


def test_a_true_pose_with_a_bad_stamp_is_skipped(bag):
    drive = the_drive(rewritten(bag, edit(GROUND_TRUTH, 7, BAD_STAMPS["a stamp that is zero"][0])))
    assert drive.ground_truth.stamps[0] > 0
    assert "Skipped 1 message of /ground_truth/odometry: its stamp is near none" in " ".join(
        drive.notes
    )


def test_stamps_that_begin_anew_make_a_second_pass(bag, small_drive):
    stamps = small_drive.feature_stamps
    middle = stamps[0] + (stamps[-1] - stamps[0]) // 2
    half = int(np.searchsorted(stamps, middle))
    foreign = rewritten(bag, from_half_on_anew(bag))
    first, second = read_passes(foreign)
    assert first.twist_stamps.tolist() == small_drive.twist_stamps[:half].tolist()
    moved = stamps[half:] - middle + stamps[0]
    assert second.twist_stamps.tolist() == second.feature_stamps.tolist() == moved.tolist()
    assert_same(second.twists, small_drive.twists[half:])
    assert_same(second.frame(3), small_drive.frame(half + 3))
    assert first.camera == second.camera == small_drive.camera
    assert len(first.ground_truth) + len(second.ground_truth) == small_drive.steps - 5
    assert not first.refused.counts
    assert not second.refused.counts


def test_frames_of_which_no_stamp_is_confirmed_are_refused(bag):
    def change(topic, index, message):
        if topic == FEATURES.recorded:
            if index:
                return None
            message.header.stamp.sec -= 1000
        return message

    foreign = rewritten(bag, change)
    with pytest.raises(VislamError, match=r"on \S+features has a stamp that another"):
        the_drive(foreign)


def test_how_far_back_a_new_pass_begins_is_a_rule(bag, small_drive):
    foreign = rewritten(bag, from_half_on_anew(bag))
    rules = ReadingRules(twist_time_jump=100.0, features_time_jump=100.0)
    drive = the_drive(foreign, rules=rules)
    assert np.all(np.diff(drive.twist_stamps) > 0)
    assert drive.steps > small_drive.steps // 2


def test_a_pass_without_motion_makes_no_drive_and_its_frames_are_counted(bag, small_drive):
    def change(topic, index, message):
        begun_anew = topic == FEATURES.recorded and index >= small_drive.steps - 3
        if begun_anew:
            message.header.stamp.sec -= 1000
        return message

    drive = the_drive(rewritten(bag, change))
    assert drive.steps == small_drive.steps - 3
    assert drive.refused.counts == {"features_no_prediction": 3}
