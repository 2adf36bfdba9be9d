# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why a message is not used: every reason with its word and what it means, in one table.

A refused message is counted under its stream and the reason's word, such as ``features_late``.
The counts stand under the same words on /diagnostics and in ``summary.json``, and mean the same
live and offline: both decode, check and order messages with the same functions.
"""

import enum
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from vislam_ros.core.ranges import PIXEL, PIXEL_NOISE, POSITION, TURN_RATE, VELOCITY, Range
from vislam_ros.errors import VislamError


class Stream(enum.Enum):
    """A kind of message, by the word under which its refused ones are counted."""

    TWIST = "twist"
    IMU = "imu"
    PREDICTION = "prediction"
    FEATURES = "features"
    CAMERA_INFO = "camera_info"
    EXTRINSICS = "extrinsics"
    STATIC_TRANSFORMS = "tf_static"
    LEFT_IMAGE = "left_image"
    RIGHT_IMAGE = "right_image"
    IMAGES = "images"


class Refusal(enum.Enum):
    """A reason: the word under which it is counted, and what it means.

    Attributes
    ----------
    word, text : str
    is_of_data : bool
        Whether the message itself is to blame: another run over the same messages refuses it
        again, if it is reset as this one was. The others are faults of the run, which keep it from
        being complete.
    """

    UNDECODABLE = ("undecodable", "its bytes are no message of the topic's type")
    BEFORE_1970 = ("before_1970", "its stamp is negative")
    UNKNOWN_FRAME = ("unknown_frame", "it speaks of another frame than the parameters")
    BAD_FIELDS = ("bad_fields", "a field is missing, or of a type or value that cannot be")
    ABSENT_FIELD = ("absent_field", "it says that it does not hold what is needed")
    WRONG_SIZE = ("wrong_size", "its data have another size than they should")
    NON_FINITE = ("non_finite", "a number is not finite")
    ABSURD = ("absurd", "a number is finite and beyond what can be")
    DUPLICATE_IDS = ("duplicate_ids", "an id appears twice")
    NOT_A_ROTATION = ("not_a_rotation", "its quaternion has not the length 1")
    NOT_A_PAIR = ("not_a_pair", "left and right are not one calibrated stereo pair")
    BAD_STAMP = ("bad_stamp", "its stamp is near none that came before or after it")
    LATE = ("late", "it came after a newer one")
    DUPLICATE = ("duplicate", "there was one with the same stamp")
    UNPAIRED = ("unpaired", "the other stream has none with the same stamp")
    NO_PREDICTION = ("no_prediction", "no predicted motion reaches its stamp")
    RESET = ("reset", "the estimate was told to begin anew while it waited")
    NO_CAMERA = ("no_camera", "the camera's calibration did not come", False)
    QUEUE_FULL = ("queue_full", "too many wait for what they need", False)
    NOT_PUBLISHED = ("not_published", "a subscriber did not take it", False)
    INTERNAL_ERROR = ("internal_error", "a node failed to use it: see its log", False)

    def __init__(self, word: str, text: str, is_of_data: bool = True):
        self.word = word
        self.text = text
        self.is_of_data = is_of_data


class RefusedMessage(VislamError):
    """A message that is not used.

    Attributes
    ----------
    refusal : Refusal
    """

    def __init__(self, refusal: Refusal, detail: str = ""):
        super().__init__(detail or refusal.text)
        self.refusal = refusal


@dataclass
class RefusalCounts:
    """Refused messages, counted under ``stream_word``, or ``word`` where there is no stream.

    Attributes
    ----------
    counts : Counter of str
    first_stamps : dict of str to int
        Stamp (ns) of the first message that was refused so, where it has one.
    """

    counts: Counter[str] = field(default_factory=Counter)
    first_stamps: dict[str, int] = field(default_factory=dict)

    def add(self, stream: Stream | None, refusal: Refusal, stamp: int | None = None) -> None:
        """Count a message, with its stream and its stamp (ns) where they are known."""
        word = refusal.word if stream is None else f"{stream.value}_{refusal.word}"
        self.counts[word] += 1
        if stamp is not None:
            self.first_stamps.setdefault(word, stamp)

    def merge(self, other: "RefusalCounts") -> None:
        """Take over the counts of another source, which come after these."""
        self.counts.update(other.counts)
        self.first_stamps = {**other.first_stamps, **self.first_stamps}


def refusal_of(word: str) -> Refusal:
    """Reason of a word with or without its stream before it.

    Raises
    ------
    ValueError
        Where there is no such reason.
    """
    for refusal in Refusal:
        if word == refusal.word or word.endswith(f"_{refusal.word}"):
            return refusal
    raise ValueError(f"{word!r} is no reason to refuse a message")


def check_range(meant: Range, values: ArrayLike) -> None:
    """Refuse numbers that lie outside what is meant; raises a RefusedMessage."""
    if complaint := meant.complaint(values):
        raise RefusedMessage(Refusal.ABSURD, complaint)


def check_twist(twist: ArrayLike) -> None:
    """Refuse what is no twist (6,) of numbers that can be; raises a RefusedMessage."""
    twist = np.asarray(twist, dtype=float)
    if twist.shape != (6,):
        raise RefusedMessage(Refusal.WRONG_SIZE)
    if not np.all(np.isfinite(twist)):
        raise RefusedMessage(Refusal.NON_FINITE)
    check_range(VELOCITY, twist[:3])
    check_range(TURN_RATE, twist[3:])


def check_angular_velocity(omega: ArrayLike) -> None:
    """Refuse what is no angular velocity (3,) that can be; raises a RefusedMessage."""
    omega = np.asarray(omega, dtype=float)
    if omega.shape != (3,):
        raise RefusedMessage(Refusal.WRONG_SIZE)
    if not np.all(np.isfinite(omega)):
        raise RefusedMessage(Refusal.NON_FINITE)
    check_range(TURN_RATE, omega)


def check_pose(position: ArrayLike, quaternion: ArrayLike) -> None:
    """Refuse what is no position (3,) and unit quaternion (4,); raises a RefusedMessage."""
    position = np.asarray(position, dtype=float)
    quaternion = np.asarray(quaternion, dtype=float)
    if position.shape != (3,) or quaternion.shape != (4,):
        raise RefusedMessage(Refusal.WRONG_SIZE)
    if not (np.all(np.isfinite(position)) and np.all(np.isfinite(quaternion))):
        raise RefusedMessage(Refusal.NON_FINITE)
    check_range(POSITION, position)
    if not abs(np.linalg.norm(quaternion) - 1.0) <= 1e-3:
        raise RefusedMessage(Refusal.NOT_A_ROTATION)


def check_features(ids: ArrayLike, pixels: ArrayLike, noise: ArrayLike | None = None) -> None:
    """Refuse what is no frame: ids (n,), each once, pixels (n, 4) and noise (n,) that can be.

    Raises
    ------
    RefusedMessage
    """
    ids, pixels = np.asarray(ids), np.asarray(pixels)
    if ids.ndim != 1 or pixels.shape != (len(ids), 4):
        raise RefusedMessage(Refusal.WRONG_SIZE)
    if not np.all(np.isfinite(pixels)):
        raise RefusedMessage(Refusal.NON_FINITE)
    check_range(PIXEL, pixels)
    if noise is not None:
        if np.shape(noise) != (len(ids),):
            raise RefusedMessage(Refusal.WRONG_SIZE)
        check_range(PIXEL_NOISE, noise)
    if not np.all(ids[1:] > ids[:-1]) and len(np.unique(ids)) != len(ids):
        raise RefusedMessage(Refusal.DUPLICATE_IDS)
