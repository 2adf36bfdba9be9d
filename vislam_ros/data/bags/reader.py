# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading a bag as drives, one for each pass over the data, as the nodes would hear it."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.settings import MotionSettings
from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, RefusedMessage, Stream
from vislam_ros.core.tracking.time_order import Passes, TimeOrder
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration
from vislam_ros.data.bags.gathered_pass import GatheredPass
from vislam_ros.data.bags.layout import (
    DEFAULT_FRAMES,
    FEATURES,
    GROUND_TRUTH,
    IMU,
    PROVENANCE,
    TWIST,
    Frames,
    Topic,
)
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.json_file import read_json
from vislam_ros.errors import VislamError

_TIME_JUMP = MotionSettings().time_jump


@dataclass(frozen=True)
class ReadingRules:
    """How the nodes would take the messages of a bag: their parameters, for the reader.

    Attributes
    ----------
    frames : Frames
        What speaks of other frames is refused.
    twist_time_jump, features_time_jump : float
        ``time_jump`` of imu_prediction_node and of slam_node, seconds.
    imu_turns : bool
        Whether the angular velocity is that of the ``imu/data`` message of the same stamp.
    """

    frames: Frames = DEFAULT_FRAMES
    twist_time_jump: float = _TIME_JUMP
    features_time_jump: float = _TIME_JUMP
    imu_turns: bool = False


DEFAULT_RULES = ReadingRules()


def read_passes(
    path: Path,
    *,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
) -> tuple[Drive, ...]:
    """Read a bag: a drive for each pass, one where its stamps never begin anew.

    What the nodes would refuse is left out, and counted in the drive's ``refused``; what only
    the order in the bag made late is used (see :mod:`vislam_ros.core.tracking.time_order`).

    Parameters
    ----------
    path : Path
        A bag directory or a bare ``.mcap`` file.
    rules : ReadingRules, optional
    topics : mapping of str to str, optional
        The bag's name for a topic of :mod:`vislam_ros.data.bags.layout`, such as
        ``{TWIST.name: "/car/twist"}``.

    Raises
    ------
    VislamError
        Where the bag cannot be read, or lacks a topic, has one of another type, or has no usable
        message on it.
    """
    with BagMessages(path) as bag:
        reading = _Reading(bag, rules, topics or {})
        for _ in reading.messages():
            pass
    reading.require_usable()
    return reading.drives(*_provenance(path))


def check_readable(path: Path, *, rules: ReadingRules = DEFAULT_RULES) -> None:
    """Read a bag until each needed topic has had a usable message, and no further.

    Raises
    ------
    VislamError
        Where :func:`read_passes` would, and in the same words.
    """
    with BagMessages(path) as bag:
        reading = _Reading(bag, rules, {})
        for _ in reading.messages():
            if not reading.unusable():
                return
    reading.require_usable()


class _Reading:
    """Sorts the messages of a bag into passes."""

    def __init__(self, bag: BagMessages, rules: ReadingRules, remapped: Mapping[str, str]):
        self._bag = bag
        self._rules = rules
        imu = (IMU,) if rules.imu_turns else ()
        self._needed = (*CALIBRATION_TOPICS, *imu, TWIST, FEATURES)
        self._names = _recorded_names((*self._needed, GROUND_TRUTH), remapped)
        self._topics = self._present()
        self._calibration = Calibration(rules.frames)
        self._first_camera: StereoCamera | None = None
        self._order = Passes(
            {
                Stream.TWIST: rules.twist_time_jump,
                Stream.IMU: rules.twist_time_jump,
                Stream.FEATURES: rules.features_time_jump,
            }
        )
        self._truth_order, self._truth_pass = TimeOrder(rules.features_time_jump), 0
        self._passes: dict[int, GatheredPass] = defaultdict(GatheredPass)
        self._usable: set[Topic] = set()
        self._faults: dict[Topic, Counter[str]] = defaultdict(Counter)

    def _present(self) -> dict[str, Topic]:
        """Topics of a drive by their names in the bag."""
        msgtypes = {connection.topic: connection.msgtype for connection in self._bag.connections}
        topics = {}
        for topic, name in self._names.items():
            if name not in msgtypes:
                if topic is GROUND_TRUTH:
                    continue
                raise VislamError(
                    f"{self._bag.path}: has no topic {name} ({topic.msgtype}): remap {topic.name} "
                    f"to one that it has: {', '.join(sorted(msgtypes)) or 'none'}"
                )
            if msgtypes[name] != topic.msgtype:
                raise VislamError(
                    f"{self._bag.path}: topic {name} has type {msgtypes[name]}: {topic.msgtype} "
                    "is needed"
                )
            topics[name] = topic
        return topics

    def messages(self) -> Iterator[None]:
        """Take the messages, one at each step, in the order of the bag."""
        for connection, _, data in self._bag.messages(self._topics.keys()):
            topic, message = self._topics[connection.topic], None
            try:
                message = self._bag.decode(connection, data)
                self._take(topic, message)
                self._usable.add(topic)
            except RefusedMessage as error:
                self._faults[topic][str(error)] += 1
                if topic.stream is not None:
                    self._passes[self._order.number(topic.stream)].refused.add(
                        topic.stream, error.refusal, decoding.stamp_if_known(message)
                    )
            yield

    def _take(self, topic: Topic, message: Any) -> None:
        frames = self._rules.frames
        if topic is TWIST:
            twist = decoding.twist(message, frames)
            self._pass_of(Stream.TWIST, twist[0]).twists.append(twist)
        elif topic is IMU:
            turn = decoding.angular_velocity(message, frames)
            self._pass_of(Stream.IMU, turn[0]).turns.append(turn)
        elif topic is FEATURES:
            frame = decoding.features(message, frames)
            gathered = self._pass_of(Stream.FEATURES, frame[0])
            if not gathered.frames:
                gathered.camera = self._calibration.camera
            gathered.frames.append(frame)
        elif topic is GROUND_TRUTH:
            pose = decoding.true_pose(message)
            self._truth_pass += self._truth_order.place(pose[0])
            self._passes[self._truth_pass].poses.append(pose)
        elif camera := self._calibration.add(topic, message):
            self._first_camera = self._first_camera or camera

    def _pass_of(self, stream: Stream, stamp: int) -> GatheredPass:
        return self._passes[self._order.place(stream, stamp)]

    def unusable(self) -> list[Topic]:
        """Needed topics that have had no usable message."""
        return [topic for topic in self._needed if topic not in self._usable]

    def require_usable(self) -> None:
        """Raise a VislamError where a needed topic has had no usable message."""
        topics_of: dict[str, list[str]] = defaultdict(list)
        for topic in self.unusable():
            reason = ", ".join(sorted(self._faults[topic])) or "it is empty"
            topics_of[reason].append(self._names[topic])
        if topics_of:
            reasons = [
                f"no usable message on {' and '.join(names)}: {reason}"
                for reason, names in topics_of.items()
            ]
            raise VislamError(f"{self._bag.path}: {'; '.join(reasons)}")

    def drives(self, name: str, notes: Sequence[str]) -> tuple[Drive, ...]:
        """Drives of the passes in which the motion reaches a frame, or of the first one."""
        assert self._first_camera is not None
        notes = [*notes, *self._notes_on_truth()]
        passes = [gathered for _, gathered in sorted(self._passes.items())]
        for gathered in passes:
            gathered.sort(imu_turns=self._rules.imu_turns)
        size = self._calibration.image_size
        return tuple(
            gathered.drive(name, gathered.camera or self._first_camera, size, notes)
            for gathered in _with_motion(passes)
        )

    def _notes_on_truth(self) -> Iterator[str]:
        for reason, count in sorted(self._faults[GROUND_TRUTH].items()):
            messages = f"message{'s' if count > 1 else ''} of {self._names[GROUND_TRUTH]}"
            yield f"Skipped {count} {messages}: {reason}."


def _with_motion(passes: Sequence[GatheredPass]) -> list[GatheredPass]:
    """Passes in which the motion reaches a frame, or the first with frames where none is.

    The frames of the others have no prediction; what they refused goes to a neighbour.
    """
    kept = [gathered for gathered in passes if gathered.has_motion()]
    kept = kept or [gathered for gathered in passes if gathered.frames][:1]
    carried = RefusalCounts()
    for gathered in passes:
        is_kept = any(gathered is one for one in kept)
        if not is_kept:
            for stamp, *_ in gathered.frames:
                gathered.refused.add(Stream.FEATURES, Refusal.NO_PREDICTION, stamp)
        carried.merge(gathered.refused)
        if is_kept:
            gathered.refused, carried = carried, RefusalCounts()
    kept[-1].refused.merge(carried)
    return kept


def _recorded_names(topics: Sequence[Topic], remapped: Mapping[str, str]) -> dict[Topic, str]:
    """Each topic's name in the bag."""
    known = {topic.name: topic for topic in topics}
    names = {topic: topic.recorded for topic in topics}
    for ours, recorded in remapped.items():
        topic = known.get(ours.lstrip("/"))
        if topic is None:
            raise VislamError(
                f"topic {ours!r} cannot be remapped: choose from "
                + ", ".join(topic.name for topic in names)
            )
        names[topic] = recorded if recorded.startswith("/") else f"/{recorded}"
    return names


def _provenance(path: Path) -> tuple[str, list[str]]:
    """Name of a drive, and notes of what was repaired when its bag was written."""
    file = path / PROVENANCE
    if not file.is_file():
        return (path.name if path.is_dir() else path.stem), []
    content = read_json(file, "where this bag comes from")
    name, notes = content.get("name"), content.get("notes")
    if not (isinstance(name, str) and isinstance(notes, list)):
        raise VislamError(
            f"{file}: has no name and no notes: convert the drive anew, or remove the file"
        )
    return name, [str(note) for note in notes]
