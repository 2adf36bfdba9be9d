# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive comes back from its bag bit for bit; foreign and faulty bags are read with care."""

from dataclasses import replace

import numpy as np
import pytest
from rewriting import (
    JUNK,
    as_foreign,
    assert_same,
    changing,
    edit,
    rewritten,
    the_drive,
    unchanged,
)
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
from vislam_ros.data.bags.reader import ReadingRules, check_readable
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.errors import VislamError

NEEDED = (*CALIBRATION_TOPICS, TWIST, FEATURES)


def test_a_drive_comes_back_the_very_same(bag, small_drive):
    assert_same(the_drive(bag), small_drive)


def test_a_drive_without_ground_truth_comes_back_the_very_same(small_drive, tmp_path):
    drive = replace(small_drive, ground_truth=None, notes=())
    write_bag(drive, tmp_path / "bag")
    assert_same(the_drive(tmp_path / "bag"), drive)


def test_a_bare_file_gives_the_drive_without_its_provenance(bag, small_drive):
    assert_same(the_drive(bag / "bag.mcap"), replace(small_drive, name="bag", notes=()))


def test_a_bag_of_the_other_storage_is_read(bag, small_drive):
    foreign = rewritten(bag, unchanged, storage=StoragePlugin.SQLITE3)
    assert_same(the_drive(foreign), as_foreign(small_drive))


def test_topics_can_have_other_names(bag, small_drive):
    foreign = rewritten(bag, unchanged, rename=lambda topic: f"{topic}_of_car")
    with pytest.raises(VislamError, match=r"foreign: has no topic /stereo/left.*/imu/data_of_car"):
        the_drive(foreign)
    names = {topic.name: f"/{topic.name}_of_car" for topic in (*NEEDED, GROUND_TRUTH)}
    assert_same(the_drive(foreign, topics=names), as_foreign(small_drive))


@pytest.mark.parametrize("namespace", ["/fleet/car", "fleet/car/"])
def test_topics_can_lie_in_a_namespace(bag, small_drive, namespace):
    foreign = rewritten(bag, unchanged, rename=lambda topic: f"/fleet/car{topic}")
    with pytest.raises(VislamError, match=r"in the namespace /fleet/car: give that with --namesp"):
        the_drive(foreign)
    assert_same(the_drive(foreign, namespace=namespace), as_foreign(small_drive))


def test_a_bag_without_the_namespace_is_read_as_it_stands(bag, small_drive):
    assert_same(the_drive(bag, namespace="/car"), small_drive)


def test_a_topic_that_is_not_read_cannot_be_remapped(bag):
    with pytest.raises(VislamError, match=r"'imu/speed' cannot be remapped: choose from .*imu/tw"):
        the_drive(bag, topics={"imu/speed": "/speed"})


@pytest.mark.parametrize("take", [the_drive, check_readable])
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
    drive = the_drive(rewritten(bag, edit(FEATURES, 6, action)))
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

    drive = the_drive(rewritten(bag, change))
    assert_same(drive.twists, np.delete(small_drive.twists, [4, 5, 9], axis=0))
    assert len(drive.ground_truth) == len(small_drive.ground_truth) - 1
    assert drive.refused.counts == {"twist_undecodable": 1, "twist_non_finite": 2}
    # The truth is no input of the estimators, so nobody refuses it.
    assert drive.notes == (
        "Skipped 1 message of /ground_truth/odometry: its quaternion has not the length 1.",
    )


@pytest.mark.parametrize("topic", CALIBRATION_TOPICS, ids=lambda topic: topic.name)
def test_a_calibration_may_repeat_itself_and_one_usable_message_is_enough(bag, small_drive, topic):
    drive = the_drive(rewritten(bag, changing(topic, lambda _, message: [JUNK, message, message])))
    assert drive.camera == small_drive.camera
    assert drive.refused.counts == {f"{topic.stream.value}_undecodable": 1}


def test_a_camera_that_cannot_be_is_refused(bag):
    def spoil(info):
        info.p = info.p.copy()
        info.p[3] = 0.0

    foreign = rewritten(bag, edit(RIGHT_CAMERA, 0, spoil))
    for take in (the_drive, check_readable):
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
    for take in (the_drive, check_readable):
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
    assert_same(the_drive(foreign, rules=rules), as_foreign(small_drive))
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


class TestTurnsOfTheImu:
    """With ``angular_velocity_source: imu`` the angular velocity is that of ``imu/data``."""

    RULES = ReadingRules(imu_turns=True)

    def test_they_take_the_place_of_the_twists(self, bag, small_drive):
        def turn(_index, message):
            message.angular_velocity.z = 0.5
            return message

        drive = the_drive(rewritten(bag, changing(IMU, turn)), rules=self.RULES)
        expected = small_drive.twists.copy()
        expected[:, 5] = 0.5
        assert_same(drive.twists, expected)

    def test_a_twist_without_one_is_counted(self, bag, small_drive):
        def lose(index, message):
            return None if index == 4 else message

        drive = the_drive(rewritten(bag, changing(IMU, lose)), rules=self.RULES)
        assert_same(drive.twists, np.delete(small_drive.twists, 4, axis=0))
        assert drive.refused.counts == {"twist_unpaired": 1}


def test_an_image_size_that_is_not_known_holds_every_feature(bag, small_drive):
    def forget(info):
        info.width = info.height = 0

    drive = the_drive(rewritten(bag, edit(LEFT_CAMERA, 0, forget)))
    largest = small_drive.pixels.reshape(-1, 2, 2).max(axis=(0, 1))
    assert all(np.array(drive.image_size) > largest)
    assert all(np.array(drive.image_size) <= largest + 1)


@pytest.mark.parametrize("content", ["{", "[]", '{"name": "x"}'])
def test_a_damaged_provenance_is_refused(bag, content):
    (bag / "provenance.json").write_text(content)
    with pytest.raises(
        VislamError, match=r"provenance\.json: (not a JSON|cannot read|has no name)"
    ):
        the_drive(bag)


def test_a_drive_of_a_gyroscope_comes_back_the_very_same_and_has_no_topic_of_twists(
    small_drive, tmp_path
):
    drive = small_drive.moved_by("gyro")
    write_bag(drive, tmp_path / "bag")
    assert_same(the_drive(tmp_path / "bag"), drive)
    with BagMessages(tmp_path / "bag") as bag:
        assert TWIST.recorded not in [connection.topic for connection in bag.connections]


def test_of_a_bag_with_twists_the_gyroscope_alone_can_be_taken(bag, small_drive):
    assert_same(
        the_drive(bag, rules=ReadingRules(motion_source="gyro")), small_drive.moved_by("gyro")
    )


def test_a_bag_without_twists_says_so_where_twists_are_wanted(small_drive, tmp_path):
    write_bag(small_drive.moved_by("gyro"), tmp_path / "bag")
    with pytest.raises(VislamError, match="has no topic /imu/twist"):
        the_drive(tmp_path / "bag", rules=ReadingRules(motion_source="twist"))
