# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags with something wrong: a change of a good bag, and what is refused of it.

The good bag is one of :data:`FRAMES` frames, with a twist for each.
"""

import copy
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from rewriting import JUNK, Change, changing, edit, unchanged

from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    FEATURES,
    IMU,
    LEFT_CAMERA,
    RIGHT_CAMERA,
    TWIST,
    Topic,
)
from vislam_ros.data.trajectory import NANOSECONDS

Action: TypeAlias = Callable[[Any], None]

FRAMES, K = 14, 6


def put_nan(cloud: Any) -> None:
    cloud.data = cloud.data.copy()
    cloud.data[4:8] = 255


def repeat_point(cloud: Any) -> None:
    cloud.data = np.concatenate([cloud.data, cloud.data[-20:]])
    cloud.width += 1
    cloud.row_step += 20


def turn_points_round(cloud: Any) -> None:
    cloud.data = cloud.data.reshape(-1, 20)[::-1].ravel()


def set_frame(message: Any) -> None:
    message.header.frame_id = "elsewhere"


def move(seconds: float) -> Action:
    def move(message: Any) -> None:
        stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        stamp += round(seconds * NANOSECONDS)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)

    return move


def at(topic: Topic, index: int, told: Callable[[Any], Any]) -> Change:
    """A change: another thing stands for one message."""
    return changing(topic, lambda place, message: told(message) if place == index else message)


def twice(message: Any) -> list[Any]:
    return [message, message]


def from_on(topics: Sequence[Topic], index: int, action: Action) -> Change:
    """A change in place of all messages of some topics from one on."""
    names = {topic.recorded for topic in topics}

    def change(name: str, place: int, message: Any) -> Any:
        if name in names and place >= index:
            action(message)
        return message

    return change


def followed_by(topic: Topic, action: Action) -> Change:
    """A change: a good calibration message, and then a spoilt one like it."""

    def told(message: Any) -> list[Any]:
        spoilt = copy.deepcopy(message)
        action(spoilt)
        return [message, spoilt]

    return at(topic, 0, told)


def put_p(place: int, value: float) -> Action:
    def put(info: Any) -> None:
        info.p = info.p.copy()
        info.p[place] += value

    return put


def spoil_rotation(transform: Any) -> None:
    transform.transform.rotation.w += 1.0


def put_twist_nan(message: Any) -> None:
    message.twist.twist.angular.z = float("nan")


def put_stamp(seconds: int, nanoseconds: int = 0) -> Action:
    return lambda message: setattr(
        message.header, "stamp", type(message.header.stamp)(seconds, nanoseconds)
    )


#: Stamps that cannot be believed, and the word under which they are counted.
BAD_STAMPS: dict[str, tuple[Action, str]] = {
    "a stamp that is zero": (put_stamp(0), "bad_stamp"),
    "a stamp an hour back": (move(-3600.0), "bad_stamp"),
    "a stamp at the end of time": (put_stamp(2**31 - 1), "bad_stamp"),
    "nanoseconds of more than a second": (put_stamp(1_700_000_000, 1_100_000_000), "bad_fields"),
}


#: Single faulty messages; name -> change, and what is refused by word.
FAULTS: dict[str, tuple[Change, dict[str, int]]] = {
    "nothing": (unchanged, {}),
    "points in another order": (edit(FEATURES, K, turn_points_round), {}),
    "a pixel is not finite": (edit(FEATURES, K, put_nan), {"features_non_finite": 1}),
    "a cloud is too short": (
        edit(FEATURES, K, lambda cloud: setattr(cloud, "width", cloud.width + 1)),
        {"features_wrong_size": 1},
    ),
    "a field is missing": (
        edit(FEATURES, K, lambda cloud: setattr(cloud, "fields", cloud.fields[:-1])),
        {"features_bad_fields": 1},
    ),
    "double ids in three clouds": (
        from_on([FEATURES], FRAMES - 3, repeat_point),
        {"features_duplicate_ids": 3},
    ),
    "features of another frame": (edit(FEATURES, K, set_frame), {"features_unknown_frame": 1}),
    "features from before 1970": (edit(FEATURES, K, move(-3e9)), {"features_before_1970": 1}),
    "features that are no message": (at(FEATURES, K, lambda _: JUNK), {"features_undecodable": 1}),
    "features sent twice": (at(FEATURES, K, twice), {"features_duplicate": 1}),
    "the first frame has no motion": (
        changing(TWIST, lambda place, message: message if place else None),
        {"features_no_prediction": 1},
    ),
    "the last frames have no motion": (
        changing(TWIST, lambda place, message: message if place < FRAMES - 4 else None),
        {"features_no_prediction": 4},
    ),
    "all frames lie behind their motion": (
        from_on([FEATURES], 0, move(0.005)),
        {"features_no_prediction": 1},
    ),
    "a twist is not finite": (edit(TWIST, K, put_twist_nan), {"twist_non_finite": 1}),
    "a twist of another frame": (edit(TWIST, K, set_frame), {"twist_unknown_frame": 1}),
    "a twist from before 1970": (edit(TWIST, K, move(-3e9)), {"twist_before_1970": 1}),
    "a twist that is no message": (at(TWIST, K, lambda _: JUNK), {"twist_undecodable": 1}),
    "a twist sent twice": (at(TWIST, K, twice), {"twist_duplicate": 1}),
    "a lost twist": (at(TWIST, K, lambda _: None), {}),
    "the first twist is from the future": (
        edit(TWIST, 0, move(100.0)),
        {"twist_bad_stamp": 1, "features_no_prediction": 1},
    ),
    "the last twist is from the future": (
        edit(TWIST, FRAMES - 1, move(100.0)),
        {"twist_bad_stamp": 1, "features_no_prediction": 1},
    ),
    "the last features are from the future": (
        edit(FEATURES, FRAMES - 1, move(100.0)),
        {"features_bad_stamp": 1},
    ),
    "the camera was away": (from_on([FEATURES, TWIST, IMU], K, move(7.0)), {}),
    **{
        f"{stream}: {name}": (edit(topic, K, action), {f"{stream}_{word}": 1})
        for topic, stream in ((TWIST, "twist"), (FEATURES, "features"))
        for name, (action, word) in BAD_STAMPS.items()
    },
    "the right camera is off by a rounding": (edit(RIGHT_CAMERA, 0, put_p(2, 1e-9)), {}),
    "the right camera has other intrinsics": (edit(RIGHT_CAMERA, 0, put_p(2, 3.0)), {}),
    "the right camera stands higher": (edit(RIGHT_CAMERA, 0, put_p(7, 20.0)), {}),
    "a camera info that is no pair": (
        followed_by(RIGHT_CAMERA, put_p(3, 1e6)),
        {"camera_info_not_a_pair": 1},
    ),
    "a camera info that is not finite": (
        followed_by(LEFT_CAMERA, put_p(0, float("nan"))),
        {"camera_info_non_finite": 1},
    ),
    "extrinsics that are no rotation": (
        followed_by(EXTRINSICS, spoil_rotation),
        {"extrinsics_not_a_rotation": 1},
    ),
    "extrinsics of other frames": (
        followed_by(EXTRINSICS, set_frame),
        {"extrinsics_unknown_frame": 1},
    ),
}


#: What leaves nothing to estimate.
NO_STEP: dict[str, tuple[Change, dict[str, int]]] = {
    "all stamps are zero": (
        from_on([TWIST], 0, lambda m: setattr(m.header, "stamp", type(m.header.stamp)(0, 0))),
        {"twist_bad_stamp": 1, "twist_duplicate": FRAMES - 1, "features_no_prediction": FRAMES},
    ),
    "all frames lie before their motion": (
        from_on([FEATURES], 0, move(-10.0)),
        {"features_no_prediction": FRAMES},
    ),
}


def rename_frames(_topic: str, _index: int, message: Any) -> Any:
    names = {"base_link": "car", "camera_left_optical": "cam"}
    for holder, name in (
        (getattr(message, "header", None), "frame_id"),
        (message, "child_frame_id"),
    ):
        if hasattr(holder, name):
            setattr(holder, name, names.get(getattr(holder, name), "map"))
    return message


#: A needed topic without a usable message; the words in which it is told.
HOPELESS: dict[str, tuple[Change, list[str]]] = {
    "frames are named otherwise": (
        rename_frames,
        ["header.frame_id is 'car'", "base_frame", "header.frame_id is 'cam'", "camera_frame"],
    ),
    "no twist is a message": (
        changing(TWIST, lambda _, __: JUNK),
        ["no usable message on /imu/twist: its bytes are no message"],
    ),
    "the cameras are no pair": (
        edit(RIGHT_CAMERA, 0, put_p(7, 1e6)),
        ["/stereo/right/camera_info", "field p: the right camera lies at"],
    ),
    "the extrinsics are no rotation": (
        edit(EXTRINSICS, 0, spoil_rotation),
        ["no usable message on /stereo/extrinsics: its quaternion"],
    ),
    "no cloud has the ids": (
        from_on([FEATURES], 0, lambda cloud: setattr(cloud, "fields", cloud.fields[1:])),
        ["no usable message on /stereo/features: ", "no field 'id'"],
    ),
}
