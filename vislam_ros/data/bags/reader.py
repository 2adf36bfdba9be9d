# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading a bag as drives, one for each pass over the data, as the nodes would hear it."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.motion import angular_twist
from vislam_ros.core.settings import MotionSettings
from vislam_ros.core.tracking.refusals import Refusal, RefusalCounts, RefusedMessage, Stream
from vislam_ros.core.tracking.time_order import Passes, TimeOrder
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration, differences
from vislam_ros.data.bags.gathered_pass import Array, GatheredPass
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
from vislam_ros.data.bags.naming import hint, names_in_bag, namespace_of
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.json_file import read_json
from vislam_ros.errors import VislamError

T = TypeVar("T", bound=tuple[Any, ...])
_Pose: TypeAlias = tuple[int, Array, Array]

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
    motion_source : str
        One of :data:`~vislam_ros.core.settings.MOTION_SOURCES`; ``auto`` takes the gyroscope where
        the bag has no topic of twists.
    """

    frames: Frames = DEFAULT_FRAMES
    twist_time_jump: float = _TIME_JUMP
    features_time_jump: float = _TIME_JUMP
    imu_turns: bool = False
    motion_source: str = "auto"


DEFAULT_RULES = ReadingRules()


def read_passes(
    path: Path,
    *,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
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
    namespace : str
        Of the robot, such as ``/robot1`` (see :mod:`vislam_ros.data.bags.naming`).

    Raises
    ------
    VislamError
        Where the bag cannot be read, or lacks a topic, has one of another type, or has no usable
        message on it.
    """
    with BagMessages(path) as bag:
        reading = _Reading(bag, rules, topics, namespace)
        for _ in reading.messages():
            pass
    reading.require_usable()
    return reading.drives(*_provenance(path))


def check_readable(
    path: Path,
    *,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
) -> dict[Topic, str]:
    """Read a bag until each needed topic has had a usable message, and no further.

    Returns
    -------
    dict of Topic to str
        What the bag calls the topics of a drive.

    Raises
    ------
    VislamError
        Where :func:`read_passes` would, and in the same words.
    """
    with BagMessages(path) as bag:
        reading = _Reading(bag, rules, topics, namespace)
        for _ in reading.messages():
            if not reading.unusable():
                break
    reading.require_usable()
    return reading.names


class _Reading:
    """Sorts the messages of a bag into passes."""

    def __init__(
        self,
        bag: BagMessages,
        rules: ReadingRules,
        renamed: Mapping[str, str] | None,
        namespace: str,
    ):
        self._bag = bag
        self._rules = rules
        recorded = [connection.topic for connection in bag.connections]
        self.names = names_in_bag(
            (*CALIBRATION_TOPICS, IMU, TWIST, FEATURES, GROUND_TRUTH),
            recorded,
            namespace_of(namespace),
            renamed,
        )
        self._motion = self._motion_topic(recorded)
        imu = (IMU,) if rules.imu_turns and self._motion is TWIST else ()
        self._needed = (*CALIBRATION_TOPICS, *imu, self._motion, FEATURES)
        self._topics = self._present()
        self._calibration = Calibration(rules.frames)
        self._first_camera: StereoCamera | None = None
        self._first_rectification: PixelRectification | None = None
        self._camera_changes: list[str] = []
        self._order = Passes(
            {
                Stream.TWIST: rules.twist_time_jump,
                Stream.IMU: rules.twist_time_jump,
                Stream.FEATURES: rules.features_time_jump,
            },
            self._refuse,
            sorts=True,
        )
        self._truth_order: TimeOrder[_Pose] = TimeOrder(
            rules.features_time_jump, self._skip_truth, sorts=True
        )
        self._truth_pass = 0
        self._passes: dict[int, GatheredPass] = defaultdict(GatheredPass)
        self._usable: set[Topic] = set()
        self._faults: dict[Topic, Counter[str]] = defaultdict(Counter)

    def _motion_topic(self, recorded: Sequence[str]) -> Topic:
        """Topic of what measures the motion."""
        source = self._rules.motion_source
        has_twists, has_imu = (self.names[topic] in recorded for topic in (TWIST, IMU))
        return (
            IMU if source == "gyro" or (source == "auto" and not has_twists and has_imu) else TWIST
        )

    def _present(self) -> dict[str, Topic]:
        """Topics of a drive by their names in the bag."""
        msgtypes = {connection.topic: connection.msgtype for connection in self._bag.connections}
        topics = {}
        for topic, name in self.names.items():
            if topic not in (*self._needed, GROUND_TRUTH):
                continue
            if name not in msgtypes:
                if topic is GROUND_TRUTH:
                    continue
                raise VislamError(
                    f"{self._bag.path}: has no topic {name} ({topic.msgtype}): "
                    f"{hint(topic, msgtypes)}"
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
                    stamp = decoding.stamp_if_known(message)
                    self._refuse(topic.stream, error.refusal, stamp)
            yield
        self._order.end()
        self._truth_order.end()

    def _take(self, topic: Topic, message: Any) -> None:
        frames = self._rules.frames
        if topic is TWIST:
            for gathered, twist in self._enter(Stream.TWIST, decoding.twist(message, frames)):
                gathered.twists.append((*twist, None))
        elif topic is IMU:
            came = (
                *decoding.angular_velocity(message, frames),
                decoding.linear_acceleration(message),
            )
            for gathered, (stamp, omega, force) in self._enter(Stream.IMU, came):
                if self._motion is IMU:
                    gathered.twists.append((stamp, angular_twist(omega), force))
                else:
                    gathered.turns.append((stamp, omega))
        elif topic is FEATURES:
            features = decoding.features(message, frames)
            for gathered, frame in self._enter(Stream.FEATURES, features):
                if not gathered.frames:
                    gathered.camera = self._calibration.camera
                    gathered.rectification = self._calibration.rectification
                gathered.frames.append(frame)
        elif topic is GROUND_TRUTH:
            pose = decoding.true_pose(message)
            for believed in self._truth_order.enter(pose[0], pose):
                self._truth_pass += believed.begins_pass
                self._passes[self._truth_pass].poses.append(believed.message)
        else:
            before = self._calibration.camera
            camera = self._calibration.add(topic, message)
            if self._first_camera is None:
                self._first_camera = camera
                self._first_rectification = self._calibration.rectification
            if before and camera:
                self._camera_changes.append(differences(before, camera))

    def _enter(self, stream: Stream, message: T) -> list[tuple[GatheredPass, T]]:
        """Passes and messages, with their stamps first, that are believed with this one."""
        entered = self._order.enter(stream, message[0], message)
        return [(self._passes[number], believed) for number, _, believed in entered]

    def _refuse(self, stream: Stream, refusal: Refusal, stamp: int | None) -> None:
        self._passes[self._order.number(stream)].refused.add(stream, refusal, stamp)

    def _skip_truth(self, refusal: Refusal, _stamp: int) -> None:
        self._faults[GROUND_TRUTH][refusal.text] += 1

    def unusable(self) -> list[Topic]:
        """Needed topics that have had no usable message."""
        return [topic for topic in self._needed if topic not in self._usable]

    def require_usable(self) -> None:
        """Raise a VislamError where a needed topic has had no usable message."""
        topics_of: dict[str, list[str]] = defaultdict(list)
        for topic in self.unusable():
            reason = ", ".join(sorted(self._faults[topic])) or "it is empty"
            topics_of[reason].append(self.names[topic])
        if topics_of:
            reasons = [
                f"no usable message on {' and '.join(names)}: {reason}"
                for reason, names in topics_of.items()
            ]
            raise VislamError(f"{self._bag.path}: {'; '.join(reasons)}")

    def drives(self, name: str, notes: Sequence[str]) -> tuple[Drive, ...]:
        """Drives of the passes in which the motion reaches a frame, or of the first one.

        Raises
        ------
        VislamError
            Where no frame has a stamp that is believed.
        """
        changes = (
            f"The calibration changes ({change}): a pass keeps the one that it begins with."
            for change in self._camera_changes
        )
        notes = [*notes, *self._notes_on_truth(), *changes]
        passes = [gathered for _, gathered in sorted(self._passes.items())]
        if not any(gathered.frames for gathered in passes):
            raise VislamError(
                f"{self._bag.path}: no message on {self.names[FEATURES]} has a stamp that another "
                "one, or the motion, confirms: are their clocks the same?"
            )
        for gathered in passes:
            stream = Stream.IMU if self._motion is IMU else Stream.TWIST
            imu_turns = self._rules.imu_turns and self._motion is TWIST
            gathered.sort(motion=stream, imu_turns=imu_turns)
            if gathered.camera is None:
                gathered.camera = self._first_camera
                gathered.rectification = self._first_rectification
        size = self._calibration.image_size
        return tuple(gathered.drive(name, size, notes) for gathered in _with_motion(passes))

    def _notes_on_truth(self) -> Iterator[str]:
        for reason, count in sorted(self._faults[GROUND_TRUTH].items()):
            messages = f"message{'s' if count > 1 else ''} of {self.names[GROUND_TRUTH]}"
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
