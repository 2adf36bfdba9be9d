# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive comes back from its bag bit for bit; foreign and faulty bags are read with care."""

from dataclasses import replace

import numpy as np
import pytest
from faulty_bags import BAD_STAMPS
from rewriting import JUNK, assert_same, changing, edit, from_half_on_anew, rewritten, unchanged
from rosbags.rosbag2 import StoragePlugin

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    FEATURES,
    GROUND_TRUTH,
    IMU,
    LEFT_CAMERA,
    RIGHT_CAMERA,
    TWIST,
    Frames,
)
from vislam_ros.data.bags.reader import ReadingRules, check_readable, read_passes
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.errors import VislamError

NEEDED = (*CALIBRATION_TOPICS, TWIST, FEATURES)
SECOND = 1_000_000_000


def read(path, **how):
    """The one drive of a bag."""
    (drive,) = read_passes(path, **how)
    return drive


def same_but(drive, **changes):
    """What a bag that was written anew beside the drive's own gives back."""
    return replace(drive, **{"name": "foreign", "notes": (), **changes})


def test_a_drive_comes_back_the_very_same(bag, small_drive):
    assert_same(read(bag), small_drive)


def test_a_drive_without_ground_truth_comes_back_the_very_same(small_drive, tmp_path):
    drive = replace(small_drive, ground_truth=None, notes=())
    write_bag(drive, tmp_path / "bag")
    assert_same(read(tmp_path / "bag"), drive)


def test_a_bare_file_gives_the_drive_without_its_provenance(bag, small_drive):
    assert_same(read(bag / "bag.mcap"), replace(small_drive, name="bag", notes=()))


def test_a_bag_of_the_other_storage_is_read(bag, small_drive):
    foreign = rewritten(bag, unchanged, storage=StoragePlugin.SQLITE3)
    assert_same(read(foreign), same_but(small_drive))


def test_topics_can_have_other_names(bag, small_drive):
    foreign = rewritten(bag, unchanged, rename=lambda topic: f"{topic}_of_car")
    with pytest.raises(VislamError, match=r"foreign: has no topic /stereo/left.*/imu/data_of_car"):
        read(foreign)
    names = {topic.name: f"/{topic.name}_of_car" for topic in (*NEEDED, GROUND_TRUTH)}
    assert_same(read(foreign, topics=names), same_but(small_drive))


@pytest.mark.parametrize("namespace", ["/fleet/car", "fleet/car/"])
def test_topics_can_lie_in_a_namespace(bag, small_drive, namespace):
    foreign = rewritten(bag, unchanged, rename=lambda topic: f"/fleet/car{topic}")
    with pytest.raises(VislamError, match=r"in the namespace /fleet/car: give that with --namesp"):
        read(foreign)
    assert_same(read(foreign, namespace=namespace), same_but(small_drive))


def test_a_bag_without_the_namespace_is_read_as_it_stands(bag, small_drive):
    assert_same(read(bag, namespace="/car"), small_drive)


def test_a_topic_that_is_not_read_cannot_be_remapped(bag):
    with pytest.raises(VislamError, match=r"'imu/speed' cannot be remapped: choose from .*imu/tw"):
        read(bag, topics={"imu/speed": "/speed"})


@pytest.mark.parametrize("take", [read, check_readable])
@pytest.mark.parametrize("topic", NEEDED, ids=lambda topic: topic.name)
class TestNeededTopic:
    def test_missing(self, bag, topic, take):
        foreign = rewritten(
            bag, unchanged, rename=lambda name: name if name != topic.recorded else None
        )
        rules = ReadingRules(motion_source="twist")
        with pytest.raises(VislamError, match=f"foreign: has no topic {topic.recorded} "):
            take(foreign, rules=rules)

    def test_of_another_type(self, bag, topic, take):
        foreign = rewritten(
            bag,
            changing(topic, lambda _i, _m: None),
            msgtype=lambda name, kind: kind if name != topic.recorded else "std_msgs/msg/String",
        )
        with pytest.raises(VislamError, match=f"{topic.name} has type std_msgs/msg/String: "):
            take(foreign)

    def test_empty(self, bag, topic, take):
        foreign = rewritten(bag, changing(topic, lambda _i, _m: None))
        with pytest.raises(VislamError, match=f"message on {topic.recorded}: it is empty"):
            take(foreign)

    def test_without_a_usable_message(self, bag, topic, take):
        foreign = rewritten(bag, changing(topic, lambda _i, _m: JUNK))
        with pytest.raises(VislamError, match=f"message on {topic.recorded}: .*no message"):
            take(foreign)


def spoil_pixel(cloud):
    cloud.data = cloud.data.copy()
    cloud.data[4:8] = 255


@pytest.mark.parametrize(
    ("action", "word", "has_stamp"),
    [
        (spoil_pixel, "features_non_finite", True),
        (lambda cloud: setattr(cloud, "width", cloud.width + 1), "features_wrong_size", True),
        (lambda cloud: setattr(cloud, "fields", cloud.fields[1:]), "features_bad_fields", True),
        (lambda cloud: setattr(cloud.header, "frame_id", "c"), "features_unknown_frame", True),
        (lambda cloud: setattr(cloud.header.stamp, "sec", -5), "features_before_1970", False),
    ],
)
def test_a_bad_features_message_is_left_out_and_counted(bag, small_drive, action, word, has_stamp):
    drive = read(rewritten(bag, edit(FEATURES, 6, action)))
    stamps = small_drive.feature_stamps.tolist()
    refused_stamp = stamps.pop(6)
    assert drive.feature_stamps.tolist() == stamps
    assert drive.steps == len(drive.offsets) - 1
    for k in (5, 6, 7):
        assert_same(drive.frame(k), small_drive.frame(k if k < 6 else k + 1))
    assert drive.refused.counts == {word: 1}
    assert drive.refused.first_stamps == ({word: refused_stamp} if has_stamp else {})


def test_bad_twists_and_poses_are_left_out_and_counted(bag, small_drive):
    def change(topic, index, message):
        if topic == TWIST.recorded and index in (4, 5):
            message.twist.twist.linear.y = float("nan")
        if topic == TWIST.recorded and index == 9:
            return JUNK
        if topic == GROUND_TRUTH.recorded and index == 2:
            message.pose.pose.orientation.w = 7.0
        return message

    drive = read(rewritten(bag, change))
    assert_same(drive.twists, np.delete(small_drive.twists, [4, 5, 9], axis=0))
    assert len(drive.ground_truth) == len(small_drive.ground_truth) - 1
    assert drive.refused.counts == {"twist_undecodable": 1, "twist_non_finite": 2}
    # The truth is no input of the estimators, so nobody refuses it.
    assert drive.notes == (
        "Skipped 1 message of /ground_truth/odometry: its quaternion has not the length 1.",
    )


@pytest.mark.parametrize("topic", CALIBRATION_TOPICS, ids=lambda topic: topic.name)
def test_a_calibration_may_repeat_itself_and_one_usable_message_is_enough(bag, small_drive, topic):
    drive = read(rewritten(bag, changing(topic, lambda _, message: [JUNK, message, message])))
    assert drive.camera == small_drive.camera
    assert drive.refused.counts == {f"{topic.stream.value}_undecodable": 1}


def test_a_camera_that_cannot_be_is_refused(bag):
    def spoil(info):
        info.p = info.p.copy()
        info.p[3] = 0.0

    foreign = rewritten(bag, edit(RIGHT_CAMERA, 0, spoil))
    for take in (read, check_readable):
        with pytest.raises(VislamError, match=r"foreign: .*stereo/right/camera_info.*field p\[3"):
            take(foreign)


def test_frames_that_are_named_otherwise_are_told_with_the_parameter_to_set(bag, small_drive):
    def rename(_topic, _index, message):
        if hasattr(message, "header"):
            names = {"base_link": "car", "camera_left_optical": "cam"}
            message.header.frame_id = names.get(message.header.frame_id, "map")
            if hasattr(message, "child_frame_id"):
                message.child_frame_id = names[message.child_frame_id]
        return message

    foreign = rewritten(bag, rename)
    for take in (read, check_readable):
        with pytest.raises(VislamError) as error:
            take(foreign)
        for words in (
            "no usable message on /stereo/extrinsics and /imu/twist: header.frame_id is 'car'",
            "set the parameter base_frame to it",
            "no usable message on /stereo/features: header.frame_id is 'cam', not 'camera_left_",
            "set the parameter camera_frame to it",
        ):
            assert words in str(error.value)
        assert "\n" not in str(error.value)
    rules = ReadingRules(frames=Frames(base="car", camera="cam"))
    assert_same(read(foreign, rules=rules), same_but(small_drive))
    check_readable(foreign, rules=rules)


def test_whether_a_bag_can_be_read_is_told_from_its_beginning(bag, monkeypatch):
    from vislam_ros.data.bags.bag_messages import BagMessages

    decoded = []
    decode = BagMessages.decode
    monkeypatch.setattr(
        BagMessages,
        "decode",
        lambda self, item, data: decoded.append(item.topic) or decode(self, item, data),
    )
    check_readable(bag)
    assert len(decoded) == len(NEEDED) + 1  # and a pose of the truth


class TestOrder:
    """Within a pass only the stamps count; the order in the bag decides where passes begin."""

    def test_what_the_log_has_shuffled_is_sorted(self, bag, small_drive):
        rng = np.random.default_rng(4)

        def later(topic, _index, time):
            return time + int(rng.uniform(0, 0.3) * SECOND) * (topic in moved)

        moved = {topic.recorded for topic in (TWIST, FEATURES, GROUND_TRUTH)}
        foreign = rewritten(bag, unchanged, log_time=later)
        assert_same(read(foreign), same_but(small_drive))

    def test_of_equal_stamps_the_first_to_come_is_used(self, bag, small_drive):
        def repeat(topic, index, message):
            if topic == TWIST.recorded and index == 7:
                later = changed_twist(message, 99.0)
                return [message, later]
            return message

        drive = read(rewritten(bag, repeat))
        assert_same(drive.twists, small_drive.twists)
        assert drive.refused.counts == {"twist_duplicate": 1}
        stamp = int(small_drive.twist_stamps[7])
        assert drive.refused.first_stamps == {"twist_duplicate": stamp}

    @pytest.mark.parametrize("topic", [TWIST, FEATURES], ids=["twist", "features"])
    def test_a_bad_stamp_is_as_if_its_message_were_not_there(self, bag, topic):
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

    def test_a_true_pose_with_a_bad_stamp_is_skipped(self, bag):
        drive = read(rewritten(bag, edit(GROUND_TRUTH, 7, BAD_STAMPS["a stamp that is zero"][0])))
        assert drive.ground_truth.stamps[0] > 0
        assert "Skipped 1 message of /ground_truth/odometry: its stamp is near none" in " ".join(
            drive.notes
        )

    def test_stamps_that_begin_anew_make_a_second_pass(self, bag, small_drive):
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

    def test_frames_of_which_no_stamp_is_confirmed_are_refused(self, bag):
        def change(topic, index, message):
            if topic == FEATURES.recorded:
                if index:
                    return None
                message.header.stamp.sec -= 1000
            return message

        foreign = rewritten(bag, change)
        with pytest.raises(VislamError, match=r"on \S+features has a stamp that another"):
            read(foreign)

    def test_how_far_back_a_new_pass_begins_is_a_rule(self, bag, small_drive):
        foreign = rewritten(bag, from_half_on_anew(bag))
        rules = ReadingRules(twist_time_jump=100.0, features_time_jump=100.0)
        drive = read(foreign, rules=rules)
        assert np.all(np.diff(drive.twist_stamps) > 0)
        assert drive.steps > small_drive.steps // 2

    def test_a_pass_without_motion_makes_no_drive_and_its_frames_are_counted(
        self, bag, small_drive
    ):
        def change(topic, index, message):
            begun_anew = topic == FEATURES.recorded and index >= small_drive.steps - 3
            if begun_anew:
                message.header.stamp.sec -= 1000
            return message

        drive = read(rewritten(bag, change))
        assert drive.steps == small_drive.steps - 3
        assert drive.refused.counts == {"features_no_prediction": 3}


def after(first, second):
    """Return both changes, one after the other."""
    return lambda topic, index, message: second(topic, index, first(topic, index, message))


def changed_twist(message, speed):
    import copy

    message = copy.deepcopy(message)
    message.twist.twist.linear.x = speed
    return message


class TestTurnsOfTheImu:
    """With ``angular_velocity_source: imu`` the angular velocity is that of ``imu/data``."""

    RULES = ReadingRules(imu_turns=True)

    def test_they_take_the_place_of_the_twists(self, bag, small_drive):
        def turn(_index, message):
            message.angular_velocity.z = 0.5
            return message

        drive = read(rewritten(bag, changing(IMU, turn)), rules=self.RULES)
        expected = small_drive.twists.copy()
        expected[:, 5] = 0.5
        assert_same(drive.twists, expected)

    def test_a_twist_without_one_is_counted(self, bag, small_drive):
        def lose(index, message):
            return None if index == 4 else message

        drive = read(rewritten(bag, changing(IMU, lose)), rules=self.RULES)
        assert_same(drive.twists, np.delete(small_drive.twists, 4, axis=0))
        assert drive.refused.counts == {"twist_unpaired": 1}


def test_an_image_size_that_is_not_known_holds_every_feature(bag, small_drive):
    def forget(info):
        info.width = info.height = 0

    drive = read(rewritten(bag, edit(LEFT_CAMERA, 0, forget)))
    largest = small_drive.pixels.reshape(-1, 2, 2).max(axis=(0, 1))
    assert all(np.array(drive.image_size) > largest)
    assert all(np.array(drive.image_size) <= largest + 1)


@pytest.mark.parametrize("content", ["{", "[]", '{"name": "x"}'])
def test_a_damaged_provenance_is_refused(bag, content):
    (bag / "provenance.json").write_text(content)
    with pytest.raises(
        VislamError, match=r"provenance\.json: (not a JSON|cannot read|has no name)"
    ):
        read(bag)


def test_a_drive_of_a_gyroscope_comes_back_the_very_same_and_has_no_topic_of_twists(
    small_drive, tmp_path
):
    drive = small_drive.moved_by("gyro")
    write_bag(drive, tmp_path / "bag")
    assert_same(read(tmp_path / "bag"), drive)
    with BagMessages(tmp_path / "bag") as bag:
        assert TWIST.recorded not in [connection.topic for connection in bag.connections]


def test_of_a_bag_with_twists_the_gyroscope_alone_can_be_taken(bag, small_drive):
    assert_same(read(bag, rules=ReadingRules(motion_source="gyro")), small_drive.moved_by("gyro"))


def test_a_bag_without_twists_says_so_where_twists_are_wanted(small_drive, tmp_path):
    write_bag(small_drive.moved_by("gyro"), tmp_path / "bag")
    with pytest.raises(VislamError, match="has no topic /imu/twist"):
        read(tmp_path / "bag", rules=ReadingRules(motion_source="twist"))
