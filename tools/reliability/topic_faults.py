# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages with something wrong, a kind each, of every topic that the estimators listen to."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from vislam_ros.data.bags.decoding import stamp_of
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    FEATURES,
    LEFT_CAMERA,
    PREDICTION,
    RIGHT_CAMERA,
    TWIST,
    Topic,
)
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.nodes.topics import message_class

STREAMS = {"features": FEATURES, "twist": TWIST, "prediction": PREDICTION}

Spoil: TypeAlias = Callable[[Any], object]
"""Changes a message in place."""

Sent: TypeAlias = Sequence[tuple[Topic, bytes]]


@dataclass(frozen=True)
class Fault:
    """What happens once in the middle of a drive.

    Attributes
    ----------
    kind : str
        What is wrong.
    stream : str
        Of which messages: one of :data:`STREAMS`, or calibration.
    change : callable
        From the message and the one after it (CDR) to what is sent in the place of either; of the
        calibration, from its messages by topic to what is sent besides.
    refused : str or None
        Word under which it is counted, or one of two by a rounding; None where nothing is refused.
    is_lost : bool
        Whether the estimate is to be as if the message had not been sent; otherwise it is to be
        as if nothing had happened.
    """

    kind: str
    stream: str
    change: Callable[..., Any]
    refused: tuple[str, ...]
    is_lost: bool


def all_faults() -> list[Fault]:
    """Every kind of every stream."""
    return [*itertools.chain.from_iterable(map(_faults_of, STREAMS)), *_faults_of_calibration()]


def _faults_of(stream: str) -> Iterator[Fault]:
    topic = STREAMS[stream]

    def fault(kind: str, change: Callable[..., Any], *words: str, is_lost: bool = True) -> Fault:
        return Fault(kind, stream, change, tuple(f"{stream}_{word}" for word in words), is_lost)

    for kind, (spoil, *words) in {**_STAMPS, **_CONTENT[stream]}.items():
        yield fault(kind, _spoilt(topic, spoil), *words)
    for kind, cut in _BYTES.items():
        yield fault(kind, _cut(cut), "undecodable")
    yield fault("sent twice", lambda one, after: ([one, one], [after]), "duplicate", is_lost=False)
    yield fault("sent late", lambda one, after: ([], [after, one]), "late")
    yield fault("not sent", lambda one, after: ([], [after]))


def _spoilt(topic: Topic, spoil: Spoil) -> Callable[..., Any]:
    return lambda one, after: ([spoilt(topic, one, spoil)], [after])


def _cut(cut: Callable[[bytes], bytes]) -> Callable[..., Any]:
    return lambda one, after: ([cut(one)], [after])


def spoilt(topic: Topic, data: bytes, spoil: Spoil) -> bytes:
    """CDR bytes of a message after a change."""
    message = deserialize_message(data, message_class(topic.msgtype))
    spoil(message)
    return bytes(serialize_message(message))


def _put_stamp(seconds: int, nanoseconds: int = 0) -> Spoil:
    def put(message: Any) -> None:
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds

    return put


def _move(seconds: float) -> Spoil:
    def move(message: Any) -> None:
        stamp = stamp_of(message.header) + round(seconds * NANOSECONDS)
        _put_stamp(*divmod(stamp, NANOSECONDS))(message)

    return move


def _too_many_nanoseconds(message: Any) -> None:
    message.header.stamp.nanosec += NANOSECONDS


def _put(path: str, value: Any) -> Spoil:
    *owners, name = path.split(".")

    def put(message: Any) -> None:
        for owner in owners:
            message = getattr(message, owner)
        setattr(message, name, value)

    return put


def _put_pixel(value: float) -> Spoil:
    def put(cloud: Any) -> None:
        cloud.data[4:8] = type(cloud.data)("B", np.float32(value).tobytes())

    return put


def _repeat_id(cloud: Any) -> None:
    cloud.data[20:24] = cloud.data[0:4]


def _put_p(place: int, value: float) -> Spoil:
    def put(info: Any) -> None:
        info.p[place] = value

    return put


#: Spoil, and the words under which it is counted.
_Kinds: TypeAlias = dict[str, tuple[Any, ...]]

_STAMPS: _Kinds = {
    "stamp negative": (_put_stamp(-5), "before_1970"),
    "stamp zero": (_put_stamp(0), "bad_stamp"),
    "stamp 1.1 s back": (_move(-1.1), "bad_stamp", "late"),
    "stamp 1 h back": (_move(-3600.0), "bad_stamp"),
    "stamp 1 h ahead": (_move(3600.0), "bad_stamp"),
    "stamp 2^31 - 1 s": (_put_stamp(2**31 - 1), "bad_stamp"),
    "nanoseconds of a second and more": (_too_many_nanoseconds, "bad_fields"),
}

_OTHER_FRAME = (_put("header.frame_id", "elsewhere"), "unknown_frame")

_CONTENT: Mapping[str, _Kinds] = {
    "features": {
        "another frame": _OTHER_FRAME,
        "a field missing": (lambda cloud: cloud.fields.pop(), "bad_fields"),
        "another size": (lambda cloud: cloud.data.pop(), "wrong_size"),
        "NaN": (_put_pixel(np.nan), "non_finite"),
        "infinity": (_put_pixel(np.inf), "non_finite"),
        "1e30": (_put_pixel(1e30), "absurd"),
        "an id twice": (_repeat_id, "duplicate_ids"),
    },
    "twist": {
        "another frame": _OTHER_FRAME,
        "NaN": (_put("twist.twist.linear.x", np.nan), "non_finite"),
        "infinity": (_put("twist.twist.angular.z", np.inf), "non_finite"),
        "1e30": (_put("twist.twist.linear.x", 1e30), "absurd"),
    },
    "prediction": {
        "another frame": _OTHER_FRAME,
        "NaN": (_put("pose.pose.position.x", np.nan), "non_finite"),
        "infinity": (_put("pose.pose.position.y", np.inf), "non_finite"),
        "1e30": (_put("pose.pose.position.x", 1e30), "absurd"),
        "no rotation": (_put("pose.pose.orientation.w", 9.0), "not_a_rotation"),
    },
}

_BYTES: Mapping[str, Callable[[bytes], bytes]] = {
    "bytes cut off": lambda data: data[: len(data) // 2],
    "other bytes": lambda data: np.random.default_rng(0).bytes(len(data)),
    "one byte": lambda data: data[:1],
}


CHANGED = "changed"
"""Kind of a calibration that is good, and another one."""


def _faults_of_calibration() -> Iterator[Fault]:
    def fault(kind: str, told: Mapping[Topic, Callable[[bytes], bytes]], *words: str) -> Fault:
        def change(messages: Mapping[Topic, bytes]) -> Sent:
            return [(topic, spoil(messages[topic])) for topic, spoil in told.items()]

        return Fault(kind, "calibration", change, words, is_lost=False)

    def by(topic: Topic, spoil: Spoil) -> Callable[[bytes], bytes]:
        return lambda data: spoilt(topic, data, spoil)

    def one(topic: Topic, spoil: Spoil) -> dict[Topic, Callable[[bytes], bytes]]:
        return {topic: by(topic, spoil)}

    further = _put("transform.translation.x", 0.5)
    yield fault(CHANGED, one(EXTRINSICS, further))
    yield fault("sent twice", dict.fromkeys((LEFT_CAMERA, RIGHT_CAMERA), lambda data: data))
    for kind, value in (("NaN", np.nan), ("infinity", np.inf)):
        yield fault(kind, one(LEFT_CAMERA, _put_p(0, value)), "camera_info_non_finite")
    yield fault("1e30", one(LEFT_CAMERA, _put_p(0, 1e30)), "camera_info_absurd")
    yield fault("a focal length of zero", one(LEFT_CAMERA, _put_p(0, 0.0)), _NO_PAIR)
    yield fault("no baseline", one(RIGHT_CAMERA, _put_p(3, 0.0)), _NO_PAIR)
    yield fault("another frame", one(EXTRINSICS, _OTHER_FRAME[0]), "extrinsics_unknown_frame")
    turned = _put("transform.rotation.w", 9.0)
    yield fault("no rotation", one(EXTRINSICS, turned), "extrinsics_not_a_rotation")
    for kind, cut in _BYTES.items():
        yield fault(kind, {EXTRINSICS: cut}, "extrinsics_undecodable")


_NO_PAIR = "camera_info_not_a_pair"
