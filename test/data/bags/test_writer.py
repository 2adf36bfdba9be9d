# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bag holds the drive as ROS expects it, and appears whole or not at all."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from places import REPOSITORY

from vislam_ros import __version__
from vislam_ros.data.bags.bag_messages import BagMessages, is_bag
from vislam_ros.data.bags.integrity import file_sha256, require_intact
from vislam_ros.data.bags.layout import FEATURES, GROUND_TRUTH, TOPICS, Frames
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.errors import VislamError


def decoded(bag: Path, topic: str) -> list[Any]:
    with BagMessages(bag) as messages:
        return [
            messages.decode(connection, raw) for connection, _, raw in messages.messages([topic])
        ]


def stamp_ns(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_every_topic_has_its_type_its_quality_of_service_and_all_messages(bag, small_drive):
    for path in (bag, bag / "bag.mcap"):
        with BagMessages(path) as messages:
            found = {item.topic: item for item in messages.connections}
        assert set(found) == {topic.recorded for topic in TOPICS}
        for topic in TOPICS:
            item = found[topic.recorded]
            assert (item.msgtype, item.qos) == (topic.msgtype, topic.qos)
            assert item.latched == topic.latched
            if topic.latched:
                assert item.count == 1
            elif topic is GROUND_TRUTH:
                assert item.count == len(small_drive.ground_truth)
            else:
                assert item.count == small_drive.steps


def test_metadata_is_of_jazzy_and_names_the_storage_file(bag, small_drive):
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["relative_file_paths"] == ["bag.mcap"]
    first = int(small_drive.twist_stamps[0])
    assert info["starting_time"]["nanoseconds_since_epoch"] == first
    assert info["duration"]["nanoseconds"] == int(small_drive.twist_stamps[-1]) - first


def test_chunks_are_compressed_and_carry_message_definitions(bag):
    with (bag / "bag.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert all(schema.data for schema in summary.schemas.values())


def test_latched_messages_come_first_and_prediction_before_features(bag, small_drive):
    with BagMessages(bag) as messages:
        log = [(item.topic, stamp) for item, stamp, _ in messages.messages()]
    places = {topic.recorded: place for place, topic in enumerate(TOPICS)}
    assert log == sorted(log, key=lambda entry: (entry[1], places[entry[0]]))
    assert {topic for topic, _ in log[:4]} == {t.recorded for t in TOPICS if t.latched}
    assert {stamp for _, stamp in log[:4]} == {int(small_drive.twist_stamps[0])}


def test_log_time_is_the_stamp_of_the_data(bag):
    with BagMessages(bag) as messages:
        for connection, stamp, raw in messages.messages():
            message = messages.decode(connection, raw)
            header = message if connection.topic != "/tf_static" else message.transforms[0]
            assert stamp_ns(header) == stamp


def test_imu_says_that_orientation_and_acceleration_are_absent(bag, small_drive):
    message = decoded(bag, "/imu/data")[7]
    assert message.header.frame_id == "base_link"
    assert message.orientation_covariance[0] == -1
    assert message.linear_acceleration_covariance[0] == -1
    omega = message.angular_velocity
    assert [omega.x, omega.y, omega.z] == small_drive.twists[7, 3:].tolist()


def test_features_are_a_dense_cloud_of_twenty_bytes_a_point(bag, small_drive):
    clouds = decoded(bag, "/stereo/features")
    ids, pixels = small_drive.frame(8)
    cloud = clouds[8]
    assert cloud.header.frame_id == "camera_left_optical"
    assert (cloud.height, cloud.width, cloud.point_step) == (1, len(ids), 20)
    assert (cloud.is_bigendian, cloud.is_dense, cloud.row_step) == (False, True, 20 * len(ids))
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        ("id", 0, 6, 1),
        ("u_left", 4, 7, 1),
        ("v_left", 8, 7, 1),
        ("u_right", 12, 7, 1),
        ("v_right", 16, 7, 1),
    ]
    words = cloud.data.reshape(-1, 20)
    assert np.array_equal(words[:, :4].copy().view("<u4")[:, 0], ids)
    assert np.array_equal(words[:, 4:].copy().view("<f4"), pixels)
    assert clouds[3].width == 0


def test_camera_info_is_of_a_rectified_pair(bag, small_drive):
    camera = small_drive.camera
    left, right = decoded(bag, "/stereo/left/camera_info") + decoded(
        bag, "/stereo/right/camera_info"
    )
    for info in (left, right):
        assert (info.width, info.height) == (1241, 376)
        assert info.distortion_model == "plumb_bob"
        assert info.d.tolist() == [0.0] * 5
        assert info.r.tolist() == np.eye(3).ravel().tolist()
        assert info.k.tolist() == [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
        P = info.p.reshape(3, 4)
        assert np.array_equal(P[:, :3], info.k.reshape(3, 3))
    assert left.p[3] == 0.0
    assert right.p[3] == -camera.fx_baseline


def test_extrinsics_are_a_transform_and_also_a_static_one(bag, small_drive):
    (extrinsics,) = decoded(bag, "/stereo/extrinsics")
    assert extrinsics.header.frame_id == "base_link"
    assert extrinsics.child_frame_id == "camera_left_optical"
    translation, q = extrinsics.transform.translation, extrinsics.transform.rotation
    camera = small_drive.camera
    assert (translation.x, translation.y, translation.z) == camera.position_body_camera
    assert (q.x, q.y, q.z, q.w) == camera.quaternion_body_camera
    (static,) = decoded(bag, "/tf_static")
    assert repr(static.transforms) == repr([extrinsics])


def test_frames_can_be_named(small_drive, tmp_path):
    write_bag(small_drive, tmp_path / "bag", frames=Frames("world", "start", "imu", "left"))
    (extrinsics,) = decoded(tmp_path / "bag", "/stereo/extrinsics")
    assert (extrinsics.header.frame_id, extrinsics.child_frame_id) == ("imu", "left")
    truth = decoded(tmp_path / "bag", "/ground_truth/odometry")[0]
    assert (truth.header.frame_id, truth.child_frame_id) == ("world", "imu")


def test_provenance_says_where_the_bag_comes_from(small_drive, tmp_path):
    source = tmp_path / "drive.npz"
    source.write_bytes(b"the dataset")
    write_bag(small_drive, tmp_path / "bag", source=source, settings={"imu_frame": "auto"})
    provenance = json.loads((tmp_path / "bag" / "provenance.json").read_text())
    assert provenance["name"] == "a drive"
    assert provenance["source"] == {"name": "drive.npz", "sha256": file_sha256(source)}
    assert provenance["vislam_ros"] == __version__
    assert provenance["settings"] == {"imu_frame": "auto"}
    assert provenance["notes"] == list(small_drive.notes)
    assert provenance["counts"]["observations"] == len(small_drive.ids)
    with BagMessages(tmp_path / "bag") as messages:
        assert provenance["messages"] == {c.topic: c.count for c in messages.connections}


def test_equal_drives_make_equal_bytes(small_drive, tmp_path):
    for folder in ("one", "two"):
        write_bag(small_drive, tmp_path / folder / "bag")
    assert contents(tmp_path / "one" / "bag") == contents(tmp_path / "two" / "bag")


def test_progress_rises_to_one(small_drive, tmp_path):
    shares: list[float] = []
    write_bag(small_drive, tmp_path / "bag", progress=shares.append)
    assert shares == sorted(shares)
    assert len(shares) > 1
    assert shares[-1] == 1.0


def test_an_existing_output_is_refused_and_kept(bag, small_drive):
    before = contents(bag)
    with pytest.raises(VislamError, match=r"bag: exists already.*--force"):
        write_bag(replace(small_drive, name="another"), bag)
    assert contents(bag) == before


def test_force_replaces_a_bag(bag, small_drive):
    write_bag(replace(small_drive, name="another"), bag, force=True)
    assert read_passes(bag)[0].name == "another"
    assert list(bag.parent.iterdir()) == [bag]


def test_force_does_not_replace_what_is_no_bag(small_drive, tmp_path):
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter.tex").write_text("years of work")
    with pytest.raises(VislamError, match="thesis: is not of the kind"):
        write_bag(small_drive, precious, force=True)
    assert (precious / "chapter.tex").read_text() == "years of work"


@pytest.mark.parametrize("first", [-1, 2**31 * 10**9])
def test_stamps_that_no_message_holds_are_refused(small_drive, tmp_path, first):
    stamps = small_drive.twist_stamps - small_drive.twist_stamps[0] + first
    drive = replace(small_drive, twist_stamps=stamps, feature_stamps=stamps, ground_truth=None)
    with pytest.raises(VislamError, match="1970 to 2038"):
        write_bag(drive, tmp_path / "bag")
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_written_is_one_line(small_drive, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(VislamError, match="cannot write it: "):
        write_bag(small_drive, tmp_path / "file" / "bag")


def interrupt(error: type[BaseException]) -> Callable[[float], None]:
    def progress(share: float) -> None:
        if share > 0.5:
            raise error

    return progress


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_conversion_leaves_nothing(small_drive, tmp_path, error):
    with pytest.raises(error):
        write_bag(small_drive, tmp_path / "bag", progress=interrupt(error))
    assert not list(tmp_path.iterdir())


def test_an_interrupted_replacement_keeps_the_old_bag(bag, small_drive):
    before = contents(bag)
    with pytest.raises(KeyboardInterrupt):
        write_bag(small_drive, bag, force=True, progress=interrupt(KeyboardInterrupt))
    assert contents(bag) == before
    assert list(bag.parent.iterdir()) == [bag]


CONVERSION_TO_KILL = """
import sys
from pathlib import Path
from vislam_ros.data.bags import writer
from vislam_ros.data.files import whole_directory
from vislam_ros.data.bags.reader import read_passes

def wait_for_the_kill(*_):
    print("reached", flush=True)
    sys.stdin.read()

moment, source, output = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
progress = None
if moment == "messages":
    progress = wait_for_the_kill
elif moment == "end of messages":
    progress = lambda share: share == 1.0 and wait_for_the_kill()
elif moment == "checksums":
    writer.write_checksums = wait_for_the_kill
elif moment == "rename":
    whole_directory._put_in_place = wait_for_the_kill
writer.write_bag(read_passes(source)[0], output, force=True, progress=progress)
"""


@pytest.mark.parametrize("moment", ["messages", "end of messages", "checksums", "rename"])
@pytest.mark.parametrize("replacing", [False, True])
def test_a_killed_conversion_leaves_nothing_that_looks_whole(bag, tmp_path, moment, replacing):
    output = tmp_path / "killed" / "out"
    if replacing:
        write_bag(replace(read_passes(bag)[0], name="the old one"), output)
    child = subprocess.Popen(
        [sys.executable, "-c", CONVERSION_TO_KILL, moment, str(bag), str(output)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=REPOSITORY,
    )
    with child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"reached\n"
        child.kill()
    assert child.returncode == -9

    if replacing:
        require_intact(output)
        assert read_passes(output)[0].name == "the old one"
    else:
        assert not output.exists()
    (remains,) = output.parent.glob(".out.*.partial/out")
    if moment != "rename":  # by then it is whole, though not yet in its place
        assert not is_bag(remains) or moment == "checksums"
        with pytest.raises(VislamError, match="SHA256SUMS: is missing"):
            require_intact(remains)

    write_bag(read_passes(bag)[0], output, force=True)
    require_intact(output)


def test_ground_truth_is_left_out_where_unknown(small_drive, tmp_path):
    write_bag(replace(small_drive, ground_truth=None), tmp_path / "bag")
    with BagMessages(tmp_path / "bag") as messages:
        topics = {item.topic for item in messages.connections}
    assert GROUND_TRUTH.recorded not in topics
    assert FEATURES.recorded in topics
