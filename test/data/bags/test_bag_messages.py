# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag as they are stored; what is no bag, or a damaged one."""

import re

import mcap.writer
import pytest
from rewriting import JUNK, STORE
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.bag_messages import BagMessages, is_bag, lacks
from vislam_ros.data.bags.layout import FEATURES, IMU
from vislam_ros.data.loading import load_drive
from vislam_ros.errors import VislamError


def read_all(path):
    with BagMessages(path) as messages:
        return list(messages.messages())


@pytest.mark.parametrize("damage", [b"", b"no bag at all", None])
def test_a_damaged_file_is_refused_in_one_line(bag, damage):
    file = bag / "bag.mcap"
    file.write_bytes(file.read_bytes()[:5000] if damage is None else damage)
    for path in (bag, file):
        with pytest.raises(VislamError, match="cannot read this bag: ") as error:
            read_all(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("word", ["many", "[1]"])
@pytest.mark.parametrize("key", ["nanoseconds", "message_count", "nanoseconds_since_epoch"])
def test_numbers_of_the_metadata_that_are_none_are_refused_in_one_line(bag, key, word):
    metadata = bag / "metadata.yaml"
    changed = re.sub(rf"\b{key}: \d+", f"{key}: {word}", metadata.read_text())
    assert changed != metadata.read_text()
    metadata.write_text(changed)
    with pytest.raises(VislamError, match="cannot read this bag: ") as error:
        read_all(bag)
    assert "\n" not in str(error.value)


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(VislamError, match="no such file"):
        read_all(tmp_path / "nothing")
    with pytest.raises(VislamError, match="is not a bag"):
        read_all(tmp_path)


def with_storage(bag, word):
    metadata = bag / "metadata.yaml"
    changed = metadata.read_text().replace("storage_identifier: mcap", word)
    assert changed != metadata.read_text()
    metadata.write_text(changed)


@pytest.mark.parametrize("word", ["''", '""', ""])
def test_the_storage_of_one_file_is_that_of_its_name_where_none_is_told(bag, word):
    with BagMessages(bag) as messages:
        expected = {each.topic: each.count for each in messages.connections}
    with_storage(bag, f"storage_identifier: {word}")
    with BagMessages(bag) as messages:
        assert {each.topic: each.count for each in messages.connections} == expected


@pytest.mark.parametrize(("word", "more"), [("rosbag", False), ("''", True)])
def test_a_storage_that_is_none_is_told_what_to_write(bag, word, more):
    with_storage(bag, f"storage_identifier: {word}")
    if more:
        (bag / "other.mcap").write_bytes((bag / "bag.mcap").read_bytes())
    message = f"storage_identifier is '?{word}'?: write mcap for .mcap files, sqlite3 for"
    with pytest.raises(VislamError, match=message), BagMessages(bag):
        pass


def test_a_bag_without_its_metadata_is_told_what_to_do(bag):
    assert lacks(bag) is None
    (bag / "metadata.yaml").unlink()
    with pytest.raises(VislamError, match=r"has bag\.mcap and no metadata\.yaml, as after a"):
        load_drive(bag)
    assert lacks(bag.parent) is None


def test_bags_are_told_from_other_paths(bag, tmp_path):
    assert is_bag(bag)
    assert is_bag(bag / "bag.mcap")
    assert not is_bag(bag / "metadata.yaml")
    assert not is_bag(tmp_path)
    assert not is_bag(tmp_path / "nothing.mcap")


def test_messages_have_times_and_counts(bag, small_drive):
    with BagMessages(bag) as messages:
        log = [stamp for _, stamp, _ in messages.messages()]
        assert (messages.start, messages.end) == (log[0], log[-1])
        assert messages.duration == log[-1] - log[0]
        assert messages.count == len(log)
    assert log[-1] == small_drive.feature_stamps[-1]


def test_messages_are_the_bytes_that_were_written(bag):
    with BagMessages(bag) as messages:
        for connection, _, raw in messages.messages():
            message = STORE.deserialize_cdr(raw, connection.msgtype)
            assert bytes(STORE.serialize_cdr(message, connection.msgtype)) == raw


def test_bytes_that_are_no_message_are_refused(bag):
    with BagMessages(bag) as messages, pytest.raises(RefusedMessage) as error:
        messages.decode(messages.connections[0], JUNK)
    assert error.value.refusal is Refusal.UNDECODABLE


def test_messages_can_be_chosen_by_topic(bag, small_drive):
    with BagMessages(bag) as messages:
        log = [connection.topic for connection, _, _ in messages.messages([IMU.recorded, "/none"])]
        assert log == [IMU.recorded] * small_drive.steps
        assert list(messages.messages([])) == []


def test_latched_messages_stay_after_a_start_offset(bag, small_drive):
    stamps = small_drive.feature_stamps
    offset = int(stamps[40] - stamps[0])
    stop = int(stamps[50] - stamps[0])
    with BagMessages(bag) as messages:
        log = [
            (connection, stamp)
            for connection, stamp, _ in messages.messages(start_offset=offset, stop_offset=stop)
        ]
        assert (
            list(messages.messages(start_offset=messages.duration + 1, topics=[IMU.recorded]))
            == []
        )
    assert all(connection.latched and stamp == stamps[0] for connection, stamp in log[:4])
    assert [stamp for connection, stamp in log if connection.topic == FEATURES.recorded] == stamps[
        40:51
    ].tolist()
    assert len(log) == 4 + 4 * 11


def test_an_empty_bag_has_no_messages(tmp_path):
    with Writer(tmp_path / "empty", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection(IMU.recorded, IMU.msgtype, typestore=STORE)
    with BagMessages(tmp_path / "empty") as messages:
        assert (messages.start, messages.end, messages.count) == (0, 0, 0)
        assert list(messages.messages()) == []


def test_messages_of_a_type_that_the_bag_defines_otherwise_are_refused(tmp_path):
    name, definition = "sensor_msgs/msg/CameraInfo", "uint32 tallness\n"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, name))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/camera_info", name, typestore=store)
        writer.write(connection, 1, store.serialize_cdr(store.types[name](7), name).tobytes())
    with BagMessages(tmp_path / "bag") as messages:
        ((connection, _, data),) = messages.messages()
        with pytest.raises(RefusedMessage) as error:
            messages.decode(connection, data)
    assert error.value.refusal is Refusal.UNDECODABLE


def test_a_quality_of_service_that_lacks_a_key_is_said_to(tmp_path):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        quality = {"offered_qos_profiles": "- history: 3\n  reliability: 1\n"}
        channel = writer.register_channel("/said", "cdr", schema, quality)
        writer.add_message(channel, 1, b"\0\1\0\0\0", 1)
        writer.finish()
    with pytest.raises(VislamError, match=r"bag\.mcap: .* its metadata lacks 'depth', of a topic"):
        read_all(path)
