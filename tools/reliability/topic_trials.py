# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One fault in the middle of a drive, on real topics to real nodes: what it costs.

The passes of all trials follow each other without a reset, as when a bag loops, and each is to be
answered as an offline estimate of the same messages is: so what a fault leaves behind would show
in the next one.
"""

import dataclasses
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import threadpoolctl
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

from reliability.live_graph import Talker, live_graph
from reliability.topic_faults import CHANGED, STREAMS, Fault
from vislam_ros.core.filters.dead_reckoning import DeadReckoning, Prediction
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.step import SlamStep
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration
from vislam_ros.data.bags.encoding import encode_drive
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, FEATURES, PREDICTION, TWIST, Topic
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.nodes import conversions
from vislam_ros.nodes.topics import message_class

FRAMES, PLACE = 110, 60

_ANSWER_SECONDS = 10.0
_QUIET_SECONDS = 1.0


@dataclass(frozen=True)
class TrialRow:
    """What became of the frames of a pass with a fault in it.

    Attributes
    ----------
    stream, kind : str
        Of the fault.
    tried, answered, same : int
        Frames that were to be answered, those that were, and those whose pose is that of the
        offline estimate, to the last bit.
    others : int
        Answers to what was not to be answered.
    counted : dict of str to int
        What the nodes have refused, by word.
    as_told : bool
        Whether that is the fault, once, and nothing else.
    """

    stream: str
    kind: str
    tried: int
    answered: int
    same: int
    others: int
    counted: dict[str, int]
    as_told: bool

    @property
    def holds(self) -> bool:
        """Whether the fault has cost its own message and nothing else, and was counted."""
        return self.tried == self.answered == self.same and not self.others and self.as_told

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON takes it."""
        return {**dataclasses.asdict(self), "holds": self.holds}


class _Messages:
    """A drive as messages, and as the estimates of what is left of it."""

    def __init__(self, drive: Drive):
        self.drive = drive
        self.of_stream: dict[Topic, list[bytes]] = {TWIST: [], FEATURES: [], PREDICTION: []}
        self.calibration: dict[Topic, bytes] = {}
        store = get_typestore(Stores.ROS2_JAZZY)
        for topic, _, data in encode_drive(drive, DEFAULT_FRAMES, store):
            if topic in CALIBRATION_TOPICS:
                self.calibration[topic] = bytes(data)
            elif topic in self.of_stream:
                self.of_stream[topic].append(bytes(data))
        self._predictions = _predictions(drive)
        for prediction in self._predictions:
            message = conversions.odometry(
                prediction.stamp,
                DEFAULT_FRAMES.odom,
                DEFAULT_FRAMES.base,
                prediction.position,
                prediction.quaternion,
                prediction.covariance,
                prediction.twist,
                prediction.twist_covariance,
            )
            self.of_stream[PREDICTION].append(bytes(serialize_message(message)))

    def poses(
        self, lost: str | None = None, camera: StereoCamera | None = None
    ) -> dict[int, bytes]:
        """Poses by stamp of an offline estimate, without the message in the middle of a stream."""
        predictions = _predictions(self.drive, PLACE) if lost == "twist" else self._predictions
        if lost == "prediction":
            predictions = [*predictions[:PLACE], *predictions[PLACE + 1 :]]
        steps: list[SlamStep] = []
        slam = Slam(SlamSettings())
        slam.set_camera(camera or self.drive.camera)
        with threadpoolctl.threadpool_limits(1):  # as slam_node: it decides the last digits
            for prediction in predictions:
                slam.add_prediction(prediction.stamp, prediction.position, prediction.quaternion)
            for k, stamp in enumerate(self.drive.feature_stamps.tolist()):
                if not (lost == "features" and k == PLACE):
                    steps += slam.add_features(stamp, *self.drive.frame(k))
        return {step.stamp: step.position.tobytes() + step.quaternion.tobytes() for step in steps}


def _predictions(drive: Drive, lost: int | None = None) -> list[Prediction]:
    reckoning = DeadReckoning(PredictionSettings())
    return [
        prediction
        for k, stamp in enumerate(drive.twist_stamps.tolist())
        if k != lost
        for prediction in reckoning.add_twist(stamp, drive.twists[k])
    ]


def measure_topic_faults(faults: Sequence[Fault]) -> Iterator[TrialRow]:
    """Try each fault; yield its row. Faults of one kind of graph are best given together.

    Parameters
    ----------
    faults : sequence of Fault

    Raises
    ------
    VislamError
        Where the nodes do not start.
    """
    drive = simulate(SimulationSettings(steps=FRAMES, landmarks=400, seed=7)).drive
    messages = _Messages(drive)
    played = [fault for fault in faults if fault.stream == "prediction"]
    others = [fault for fault in faults if fault.stream != "prediction"]
    # Predictions come from here where they are to be spoilt: so there is one that sends them.
    for some, nodes, motion in (
        (others, ("imu_prediction_node", "slam_node"), TWIST),
        (played, ("slam_node",), PREDICTION),
    ):
        if some:
            topics = (*CALIBRATION_TOPICS, motion, FEATURES)
            with live_graph(nodes, topics) as talker:
                for topic in CALIBRATION_TOPICS:
                    talker.send(topic, messages.calibration[topic])
                for fault in some:
                    yield _Trial(messages, talker, motion).row(fault)


@dataclass
class _Trial:
    messages: _Messages
    talker: Talker
    motion: Topic

    def row(self, fault: Fault) -> TrialRow:
        """Play a pass with a fault; a changed calibration is good for another."""
        before = self.talker.refused()
        is_calibration = fault.stream == "calibration"
        besides = fault.change(self.messages.calibration) if is_calibration else []
        expected = self.messages.poses(fault.stream if fault.is_lost else None)
        tally = Counter(self._play(None if is_calibration else fault, besides, expected))
        if fault.kind == CHANGED:
            tally.update(self._play(None, [], self.messages.poses(camera=self._camera(besides))))
            for topic in CALIBRATION_TOPICS:
                self.talker.send(topic, self.messages.calibration[topic])
            self.talker.until(self.talker.has_arrived, _ANSWER_SECONDS)
        counted = dict(self.talker.refused() - before)
        as_told = (
            not counted
            if not fault.refused
            else any(counted == {word: 1} for word in fault.refused)
        )
        return TrialRow(
            fault.stream,
            fault.kind,
            tried=tally["tried"],
            answered=tally["answered"],
            same=tally["same"],
            others=tally["others"],
            counted=counted,
            as_told=as_told,
        )

    def _play(
        self,
        fault: Fault | None,
        besides: Sequence[tuple[Topic, bytes]],
        expected: Mapping[int, bytes],
    ) -> dict[str, int]:
        """Send a pass, and hold the answers against what is expected."""
        talker = self.talker
        talker.poses.clear()
        slots = {topic: self._slots(topic, fault) for topic in (self.motion, FEATURES)}
        for k in range(FRAMES):
            if k == PLACE and besides:
                talker.until(lambda: len(talker.poses) >= PLACE, _ANSWER_SECONDS)
                for topic, data in besides:
                    talker.send(topic, data)
            for topic, sent in slots.items():
                for data in sent[k]:
                    talker.send(topic, data)
        self._hear_out(len(expected))
        told = dict(talker.poses)
        return {
            "tried": len(expected),
            "answered": sum(stamp in told for stamp in expected),
            "same": sum(told.get(stamp) == pose for stamp, pose in expected.items()),
            "others": len(talker.poses) - sum(stamp in told for stamp in expected),
        }

    def _hear_out(self, answers: int) -> None:
        """Wait until all was taken and so many frames are answered, or no more comes."""
        talker, news = self.talker, (0, time.monotonic())

        def is_over() -> bool:
            nonlocal news
            now = time.monotonic()
            if len(talker.poses) != news[0] or not talker.has_arrived():
                news = len(talker.poses), now
            return talker.has_arrived() and (
                len(talker.poses) >= answers or now - news[1] > _QUIET_SECONDS
            )

        talker.until(is_over, _ANSWER_SECONDS)

    def _slots(self, topic: Topic, fault: Fault | None) -> list[list[bytes]]:
        """Return what is sent of a stream in the place of each message."""
        data = self.messages.of_stream[topic]
        slots = [[message] for message in data]
        if fault is not None and STREAMS[fault.stream] is topic:
            slots[PLACE : PLACE + 2] = fault.change(data[PLACE], data[PLACE + 1])
        return slots

    def _camera(self, besides: Sequence[tuple[Topic, bytes]]) -> StereoCamera:
        """Camera after a change."""
        calibration = Calibration(DEFAULT_FRAMES)
        for topic, data in [*self.messages.calibration.items(), *besides]:
            calibration.add(topic, deserialize_message(data, message_class(topic.msgtype)))
        assert calibration.camera is not None
        return calibration.camera
