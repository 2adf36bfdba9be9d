# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive comes back from its bag bit for bit; foreign and faulty bags are read with care."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags.layout import LATCHED_QOS, STREAM_QOS
from vislam_ros.data.bags.reader import BagMessages, is_bag, read_drive
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

STORE = get_typestore(Stores.ROS2_JAZZY)
FIELD = STORE.types["sensor_msgs/msg/PointField"]


@pytest.fixture
def bag(small_drive: Drive, tmp_path: Path) -> Path:
    write_bag(small_drive, tmp_path / "bag")
    return tmp_path / "bag"


def assert_same(one: Any, other: Any) -> None:
    """Equal type for type and bit for bit."""
    assert type(one) is type(other)
    if isinstance(one, Drive | Trajectory):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert one.tobytes() == other.tobytes()
    elif isinstance(one, tuple):
        for own, others in zip(one, other, strict=True):
            assert_same(own, others)
    else:
        assert one == other


def rewritten(
    bag: Path,
    change: Callable[[str, int, Any], Any],
    rename: Callable[[str], str | None] = lambda topic: topic,
    msgtype: Callable[[str, str], str] = lambda _, msgtype: msgtype,
    storage: StoragePlugin = StoragePlugin.MCAP,
) -> Path:
    """Another bag with each message changed: None leaves it out, bytes stand as they are."""
    output = bag.parent / "foreign"
    with BagMessages(bag) as source, Writer(output, version=9, storage_plugin=storage) as writer:
        connections, counts = {}, dict.fromkeys((c.topic for c in source.connections), 0)
        for item in source.connections:
            if name := rename(item.topic):
                connections[item.topic] = writer.add_connection(
                    name,
                    msgtype(item.topic, item.msgtype),
                    typestore=STORE,
                    offered_qos_profiles=[LATCHED_QOS if item.latched else STREAM_QOS],
                )
        for item, stamp, raw in source.messages():
            if item.topic in connections:
                message = STORE.deserialize_cdr(raw, item.msgtype)
                message = change(item.topic, counts[item.topic], message)
                counts[item.topic] += 1
                if message is not None:
                    if not isinstance(message, bytes):
                        message = STORE.serialize_cdr(message, item.msgtype)
                    writer.write(connections[item.topic], stamp, message)
    return output


def unchanged(_topic: str, _index: int, message: Any) -> Any:
    return message


def changing(topic: str, change: Callable[[int, Any], Any]) -> Callable[[str, int, Any], Any]:
    """A change of one topic's messages only; what it returns is what stands."""
    return lambda name, index, message: change(index, message) if name == topic else message


def edit(topic: str, index: int, action: Callable[[Any], object]) -> Callable[..., Any]:
    """A change in place of one message."""

    def change(place: int, message: Any) -> Any:
        if place == index:
            action(message)
        return message

    return changing(topic, change)


def test_a_drive_comes_back_the_very_same(bag, small_drive):
    assert_same(read_drive(bag), small_drive)


def test_a_drive_without_ground_truth_comes_back_the_very_same(small_drive, tmp_path):
    drive = replace(small_drive, ground_truth=None, notes=())
    write_bag(drive, tmp_path / "bag")
    assert_same(read_drive(tmp_path / "bag"), drive)


def test_a_bare_file_gives_the_drive_without_its_provenance(bag, small_drive):
    assert_same(read_drive(bag / "bag.mcap"), replace(small_drive, name="bag", notes=()))


def test_a_bag_of_the_other_storage_is_read(bag, small_drive):
    foreign = rewritten(bag, unchanged, storage=StoragePlugin.SQLITE3)
    assert_same(read_drive(foreign), replace(small_drive, name="foreign", notes=()))


def test_topics_can_have_other_names(bag, small_drive):
    foreign = rewritten(bag, unchanged, rename=lambda topic: f"/car{topic}")
    names = ["imu/twist", "stereo/features", "stereo/extrinsics", "/ground_truth/odometry"]
    names += ["stereo/left/camera_info", "stereo/right/camera_info"]
    with pytest.raises(VislamError, match=r"foreign: has no topic /stereo/left.*/car/imu/data"):
        read_drive(foreign)
    drive = read_drive(foreign, topics={name: f"/car/{name.lstrip('/')}" for name in names})
    assert_same(drive, replace(small_drive, name="foreign", notes=()))


def test_a_topic_that_is_not_read_cannot_be_remapped(bag):
    with pytest.raises(VislamError, match=r"'imu/speed' cannot be remapped: choose from .*imu/tw"):
        read_drive(bag, topics={"imu/speed": "/speed"})


@pytest.mark.parametrize(
    "topic",
    [
        "/imu/twist",
        "/stereo/features",
        "/stereo/left/camera_info",
        "/stereo/right/camera_info",
        "/stereo/extrinsics",
    ],
)
class TestNeededTopic:
    def test_missing(self, bag, topic):
        foreign = rewritten(bag, unchanged, rename=lambda name: name if name != topic else None)
        with pytest.raises(VislamError, match=f"foreign: has no topic {topic} "):
            read_drive(foreign)

    def test_of_another_type(self, bag, topic):
        foreign = rewritten(
            bag,
            changing(topic, lambda _i, _m: None),
            msgtype=lambda name, kind: kind if name != topic else "std_msgs/msg/String",
        )
        with pytest.raises(VislamError, match=f"{topic} has type std_msgs/msg/String: .* needed"):
            read_drive(foreign)

    def test_empty(self, bag, topic):
        foreign = rewritten(bag, changing(topic, lambda _i, _m: None))
        with pytest.raises(VislamError, match=f"{topic} has no usable message: it is empty"):
            read_drive(foreign)

    def test_without_a_usable_message(self, bag, topic):
        foreign = rewritten(bag, changing(topic, lambda _i, _m: b"\x00\x01\x00\x00junk"))
        with pytest.raises(VislamError, match=f"{topic} has no usable message: .*not a message"):
            read_drive(foreign)


@pytest.mark.parametrize("name", ["id", "u_left", "v_left", "u_right", "v_right"])
def test_a_missing_field_is_named(bag, name):
    def drop(_index: int, cloud: Any) -> Any:
        cloud.fields = [field for field in cloud.fields if field.name != name]
        return cloud

    foreign = rewritten(bag, changing("/stereo/features", drop))
    with pytest.raises(VislamError, match=f"foreign: topic /stereo/features: .*no field '{name}'"):
        read_drive(foreign)


@pytest.mark.parametrize(("name", "datatype"), [("id", 7), ("u_left", 5), ("v_right", 99)])
def test_a_field_of_an_unfit_type_is_named(bag, name, datatype):
    def retype(_index: int, cloud: Any) -> Any:
        for field in cloud.fields:
            if field.name == name:
                field.datatype = datatype
        return cloud

    foreign = rewritten(bag, changing("/stereo/features", retype))
    with pytest.raises(VislamError, match=f"/stereo/features: .*'{name}' has datatype {datatype}"):
        read_drive(foreign)


def test_a_cloud_of_any_layout_is_read(bag, small_drive):
    """Doubles, other order and offsets, big endian, further fields, padded rows."""
    dtype = np.dtype(
        {
            "names": ["v_right", "quality", "u_right", "v_left", "id", "u_left"],
            "formats": [">f8", "u1", ">f4", ">f8", ">u2", ">f4"],
            "offsets": [8, 0, 20, 24, 2, 40],
            "itemsize": 50,
        }
    )
    codes = {"f8": 8, "u1": 2, "f4": 7, "u2": 4}

    def relayout(index: int, cloud: Any) -> Any:
        ids, pixels = small_drive.frame(index)
        points = np.zeros(len(ids), dtype=dtype)
        points["id"] = ids
        points["u_left"], points["v_left"], points["u_right"], points["v_right"] = pixels.T
        padded = np.zeros((len(ids), 53), dtype=np.uint8)
        padded[:, :50] = points.view(np.uint8).reshape(-1, 50)
        cloud.fields = [
            FIELD(name=name, offset=offset, datatype=codes[kind.str[1:]], count=1)
            for name, (kind, offset) in dtype.fields.items()
        ]
        cloud.height, cloud.width = len(ids), 1
        if len(ids) == 1:
            padded = padded[:, :50]
        cloud.point_step, cloud.row_step, cloud.is_bigendian = 50, 53, True
        cloud.data = padded.ravel()
        return cloud

    foreign = rewritten(bag, changing("/stereo/features", relayout))
    assert_same(read_drive(foreign), replace(small_drive, name="foreign", notes=()))


def test_features_are_sorted_by_id(bag, small_drive):
    def turn(_index: int, cloud: Any) -> Any:
        cloud.data = cloud.data.reshape(-1, 20)[::-1].ravel()
        return cloud

    foreign = rewritten(bag, changing("/stereo/features", turn))
    assert_same(read_drive(foreign), replace(small_drive, name="foreign", notes=()))


def spoil_pixel(cloud: Any) -> None:
    cloud.data = cloud.data.copy()
    cloud.data[4:8] = 255


def repeat_point(cloud: Any) -> None:
    cloud.data = np.concatenate([cloud.data, cloud.data[:20]])
    cloud.width += 1


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        (spoil_pixel, "not finite"),
        (repeat_point, "an id appears twice"),
        (lambda cloud: setattr(cloud, "width", cloud.width + 1), "data has another length"),
        (lambda cloud: setattr(cloud, "point_step", 12), "field reaches beyond the point"),
        (lambda cloud: setattr(cloud.header.stamp, "sec", 5), "not later"),
        (lambda cloud: setattr(cloud.header.stamp, "sec", -5), "before 1970"),
    ],
)
def test_a_bad_features_message_is_left_out_and_counted(bag, small_drive, action, reason):
    drive = read_drive(rewritten(bag, edit("/stereo/features", 6, action)))
    assert drive.feature_stamps.tolist() == np.delete(small_drive.feature_stamps, 6).tolist()
    assert drive.steps == len(drive.offsets) - 1
    for k in (5, 6, 7):
        assert_same(drive.frame(k), small_drive.frame(k if k < 6 else k + 1))
    (note,) = drive.notes
    assert note.startswith("Skipped 1 message of /stereo/features: ")
    assert reason in note


def test_bad_twists_and_poses_are_left_out_and_counted(bag, small_drive):
    def change(topic: str, index: int, message: Any) -> Any:
        if topic == "/imu/twist" and index in (4, 5):
            message.twist.twist.linear.y = float("nan")
        if topic == "/imu/twist" and index == 9:
            return b"\x00\x01\x00\x00cut off"
        if topic == "/ground_truth/odometry" and index == 2:
            message.pose.pose.orientation.w = 7.0
        return message

    drive = read_drive(rewritten(bag, change))
    assert_same(drive.twists, np.delete(small_drive.twists, [4, 5, 9], axis=0))
    assert drive.ground_truth is not None
    assert len(drive.ground_truth) == len(small_drive.ground_truth) - 1
    assert drive.notes == (
        "Skipped 1 message of /imu/twist: not a message of its type.",
        "Skipped 2 messages of /imu/twist: not finite.",
        "Skipped 1 message of /ground_truth/odometry: not a unit quaternion.",
    )


@pytest.mark.parametrize("topic", ["/stereo/left/camera_info", "/stereo/extrinsics"])
def test_the_first_usable_calibration_counts(bag, small_drive, topic):
    """A latched topic may repeat itself; only one message is needed."""
    output = bag.parent / "repeated"
    with BagMessages(bag) as source, Writer(output, version=9) as writer:
        connections = {
            item.topic: writer.add_connection(item.topic, item.msgtype, typestore=STORE)
            for item in source.connections
        }
        for item, stamp, raw in source.messages():
            if item.topic == topic:
                writer.write(connections[item.topic], stamp, b"\x00\x01\x00\x00bad")
                writer.write(connections[item.topic], stamp, raw)
            writer.write(connections[item.topic], stamp, raw)
    drive = read_drive(output)
    assert drive.camera == small_drive.camera
    assert drive.notes == (f"Skipped 1 message of {topic}: not a message of its type.",)


def set_p(place: int, value: float) -> Callable[[Any], None]:
    def action(info: Any) -> None:
        info.p = info.p.copy()
        info.p[place] = value

    return action


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [
        (3, 0.0, r"field p\[3\] of the right camera is 0.0: it must be -fx times the baseline"),
        (2, 1.0, "field p differs in focal length or principal point"),
        (0, 0.0, "field p has no positive focal length"),
        (5, float("nan"), "not finite"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(bag, place, value, reason):
    foreign = rewritten(bag, edit("/stereo/right/camera_info", 0, set_p(place, value)))
    with pytest.raises(VislamError, match=f"foreign: .*/stereo/right/camera_info.*{reason}"):
        read_drive(foreign)


def test_an_image_size_that_is_not_known_holds_every_feature(bag, small_drive):
    def forget(info: Any) -> None:
        info.width = info.height = 0

    drive = read_drive(rewritten(bag, edit("/stereo/left/camera_info", 0, forget)))
    largest = small_drive.pixels.reshape(-1, 2, 2).max(axis=(0, 1))
    assert all(np.array(drive.image_size) > largest)
    assert all(np.array(drive.image_size) <= largest + 1)


@pytest.mark.parametrize("damage", [b"", b"no bag at all", None])
def test_a_damaged_file_is_refused_in_one_line(bag, damage):
    file = bag / "bag.mcap"
    file.write_bytes(file.read_bytes()[:5000] if damage is None else damage)
    for path in (bag, file):
        with pytest.raises(VislamError, match="cannot read this bag: ") as error:
            read_drive(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", ["{", "[]", '{"name": "x"}'])
def test_a_damaged_provenance_is_refused(bag, content):
    (bag / "provenance.json").write_text(content)
    with pytest.raises(VislamError, match=r"provenance\.json: cannot read it"):
        read_drive(bag)


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(VislamError, match="no such file"):
        read_drive(tmp_path / "nothing")
    with pytest.raises(VislamError, match="is not a bag"):
        read_drive(tmp_path)


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


def test_messages_can_be_chosen_by_topic(bag, small_drive):
    with BagMessages(bag) as messages:
        log = [connection.topic for connection, _, _ in messages.messages(["/imu/data", "/none"])]
        assert log == ["/imu/data"] * small_drive.steps
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
            list(messages.messages(start_offset=messages.duration + 1, topics=["/imu/data"])) == []
        )
    assert all(connection.latched and stamp == stamps[0] for connection, stamp in log[:4])
    assert [
        stamp for connection, stamp in log if connection.topic == "/stereo/features"
    ] == stamps[40:51].tolist()
    assert len(log) == 4 + 4 * 11


def test_an_empty_bag_has_no_messages(tmp_path):
    with Writer(tmp_path / "empty", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=STORE)
    with BagMessages(tmp_path / "empty") as messages:
        assert (messages.start, messages.end, messages.count) == (0, 0, 0)
        assert list(messages.messages()) == []
    with pytest.raises(VislamError, match="has no topic"):
        read_drive(tmp_path / "empty")
