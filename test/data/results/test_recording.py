# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which pass of a live run a verdict is on, and what of its messages is kept once."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore
from step_rows import step_row

from vislam_ros.core.verdict.reason import Judgement, Word
from vislam_ros.data.bags.layout import EXTRINSICS, ODOMETRY, STEPS
from vislam_ros.data.results.recording import Pose, Raw, Recording
from vislam_ros.data.results.summary import read_summary

STAMPS = [k * 100_000_000 for k in range(1, 6)]
BAD = ("one", "two")


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return Recording(tmp_path / "run", force=False, record_mcap=False)


def add_steps(recording: Recording, stamps: list[int]) -> None:
    for stamp in stamps:
        pose = Pose(
            stamp,
            np.zeros(3),
            np.array([0.0, 0.0, 0.0, 1.0]),
            Raw(ODOMETRY, b""),
            "map",
            "base_link",
        )
        row = step_row(stamp, first_of_pass=stamp in (STAMPS[0], STAMPS[0] + 1))
        recording.add_step(pose, np.eye(6), row, Raw(STEPS, b""), latency_ms=1.0)


def verdict_in(directory: Path) -> tuple[str | None, list[str]]:
    summary = read_summary(directory / "summary.json")
    return summary["verdict"], summary["verdict_reasons"]


def test_each_pass_has_the_verdict_on_its_own_steps(recording: Recording, tmp_path: Path) -> None:
    first = Judgement(STAMPS[-1] + 1, Word.DOUBTFUL, BAD)
    add_steps(recording, [stamp + 1 for stamp in STAMPS])
    recording.set_verdict(Judgement(STAMPS[2] + 1, Word.GOOD, ()))
    add_steps(recording, STAMPS[:1])
    # Of the pass before and of this one, as a report has them.
    recording.set_verdict(first)
    recording.set_verdict(Judgement(STAMPS[0], Word.GOOD, ()))
    add_steps(recording, STAMPS[1:])
    recording.set_verdict(first)
    recording.set_verdict(Judgement(STAMPS[-1], Word.CONTRADICTION, BAD[:1]))
    recording.finish(complete=True)
    assert verdict_in(tmp_path / "run") == ("doubtful", list(BAD))
    assert verdict_in(tmp_path / "run" / "pass_002") == ("contradiction", ["one"])


def test_each_pass_is_judged_by_the_frames_that_it_lost_itself(
    recording: Recording, tmp_path: Path
) -> None:
    for begin, lost in ((1, 5), (0, 9)):
        stamps = [stamp + begin for stamp in STAMPS]
        add_steps(recording, stamps)
        recording.set_verdict(Judgement(stamps[-1], Word.GOOD, ()))
        recording.set_refused({"features_late": lost}, {"features_late": "1.5"})
    recording.finish(complete=True)
    (first, told), (second, told_then) = (
        verdict_in(tmp_path / "run" / name) for name in ("", "pass_002")
    )
    assert first == second == "doubtful"
    assert told[0].startswith("50% of the frames have no pose: 5 features_late (it came after")
    assert "the first at 1.5 s" in told[0]
    assert told_then[0].startswith("44% of the frames have no pose: 4 features_late")
    assert "1.5" not in told_then[0]


def test_a_verdict_on_all_steps_gives_way_to_no_other(
    recording: Recording, tmp_path: Path
) -> None:
    add_steps(recording, STAMPS)
    recording.flush()
    assert verdict_in(tmp_path / "run") == (None, [])
    recording.set_verdict(Judgement(STAMPS[-1], Word.DOUBTFUL, BAD))
    # Of a pass that is yet to be heard of.
    recording.set_verdict(Judgement(STAMPS[0], Word.GOOD, ()))
    recording.flush()
    assert verdict_in(tmp_path / "run") == ("doubtful", list(BAD))


def extrinsics(stamp: int, x: float, padding: int) -> Raw:
    """Extrinsics whose serialiser leaves such bytes between their fields."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    message = types[EXTRINSICS.msgtype](
        types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](stamp, 0), "base_link"),
        "camera_left",
        types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](x, 0.0, 0.0),
            types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )
    data = bytearray(store.serialize_cdr(message, EXTRINSICS.msgtype))
    after_name = data.index(b"base_link\0") + len(b"base_link\0")
    assert data[after_name : after_name + 2] == b"\0\0"
    data[after_name : after_name + 2] = 2 * bytes([padding])
    return Raw(EXTRINSICS, bytes(data))


def test_what_is_latched_is_kept_once_whatever_lies_between_its_fields(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "run", force=False, record_mcap=True)
    for k, x in enumerate([1.0, 1.0, 1.0, 2.0]):
        recording.add_latched(extrinsics(k, x, padding=7 * k))
    add_steps(recording, STAMPS)
    recording.finish(complete=True)
    with (tmp_path / "run" / "results.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(topics=EXTRINSICS.recorded)
        kept = [message.data for *_, message in messages]
    assert kept == [extrinsics(0, 1.0, 0).data, extrinsics(3, 2.0, 21).data]
