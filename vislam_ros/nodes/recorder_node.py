# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder: writes what the graph answers as a result directory, and knows when it is whole.

A run ends when the player says that it has finished, and all that it has sent has arrived and
come to something: see :mod:`vislam_ros.data.results.completeness`.
"""

import functools
import os
import sys
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from vislam_ros.core.step import Row
from vislam_ros.core.tracking.refusals import Refusal
from vislam_ros.core.tracking.stamp_pairs import StampPairs
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    EXTRINSICS,
    GYRO_BIAS,
    IMAGES,
    LANDMARKS,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    STEPS,
    Topic,
)
from vislam_ros.data.results.completeness import (
    TRACKER,
    Ledger,
    NodeReport,
    RecordedSteps,
)
from vislam_ros.data.results.recording import PLAYER_INTERRUPTED, STOPPED, Pose, Raw, Recording
from vislam_ros.data.results.scene import static_transform
from vislam_ros.errors import SettingsError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor, neighbour
from vislam_ros.nodes.parameters import declare_settings, warn_of_undeclared_overrides
from vislam_ros.nodes.recorder.ending import Ending
from vislam_ros.nodes.recorder.heard_player import HeardPlayer
from vislam_ros.nodes.recorder.map_request import MapRequest
from vislam_ros.nodes.recorder.parameter_changes import Changes, changes_from_values
from vislam_ros.nodes.recorder.parameter_query import ParameterQuery
from vislam_ros.nodes.settings import RecorderSettings
from vislam_ros.nodes.slam_report import (
    PRESENT,
    PREVIOUS,
    process_from_values,
    row_from_values,
    verdict_from_values,
)
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.steady import steady_timer

GRACE_SECONDS = 5.0
"""How long the recorder waits without progress for what the player has sent."""

ANSWER_SECONDS = 5.0
"""How long it waits for the nodes' parameters, and for the map where nobody offers one."""

SILENCE_SECONDS = 0.5
"""How long slam_node may say nothing to that where a player is there, as in ``vislam run``."""

QUERIED = ("imu_prediction_node", "slam_node")
"""Nodes whose parameters go into ``params.yaml``."""

_TICK_SECONDS = 0.1
_Step = tuple[Pose, Any, Row, Raw, float, int, Changes]
_NICENESS = 10


class RecorderNode(Node):
    """Node ``recorder_node``; its files are closed by ``destroy_node``."""

    def __init__(self, **options: Any):
        super().__init__("recorder_node", **options)
        settings = declare_settings(self, RecorderSettings)
        if not settings.directory:
            raise SettingsError("directory: is not set: give the result directory to write")
        self.recording = Recording(
            Path(settings.directory), force=settings.force, record_mcap=settings.record_mcap
        )
        self._player = HeardPlayer()
        self._ledger = Ledger()
        self._steps = 0
        self._recorded = RecordedSteps()
        self._last_progress = self._heard_slam_node = time.monotonic()
        self._waiting_since: float | None = None
        self._ending: Ending[_Step] | None = None
        self._winds_up = False
        self._pairs = StampPairs(self._refuse_unpaired)
        own = {field.name: getattr(settings, field.name) for field in fields(RecorderSettings)}
        self._parameters_of: dict[str, dict[str, Any]] = {"recorder_node": own}
        self.monitor = Monitor(self, self._describe)
        self._map = MapRequest(self, self.monitor.guard("map", self._on_map_request))
        on_parameters = self.monitor.guard("parameters", self._on_parameters)
        self._query = ParameterQuery(self, QUERIED, on_parameters, if_there=(TRACKER,))
        self._record(ODOMETRY, self.on_odometry)
        self._record(STEPS, self.on_step)
        self._record(GYRO_BIAS, self.on_gyro_bias)
        self._record(PREDICTION, self.on_prediction)
        self._record(LANDMARKS, self.on_landmarks)
        self._record(PLAYER, self.on_player)
        self._record(DIAGNOSTICS, self.on_diagnostics)
        for topic in CALIBRATION_TOPICS:
            self._record(topic, functools.partial(self.on_calibration, topic), counted=False)
        self.monitor.serve("~/flush", self.flush)
        self.monitor.serve("~/finish", self.finish)
        warn_of_undeclared_overrides(self)
        steady_timer(self, _TICK_SECONDS, self.monitor.guard("timer", self.on_tick))

    def _record(
        self, topic: Topic, callback: Callable[[Any, Raw], None], *, counted: bool = True
    ) -> None:
        """Subscribe, keeping the messages' bytes as they came."""

        def on_message(message: Any, data: bytes) -> None:
            callback(message, Raw(topic, data))

        self.monitor.subscribe(topic, on_message, with_data=True, counted=counted)

    def on_odometry(self, message: Odometry, raw: Raw) -> None:
        """Take the pose of a step."""
        pose = _pose(message, raw)
        covariance = conversions.covariance_from_odometry(message)
        self._take_step(pose.stamp, self._pairs.add(0, pose.stamp, (pose, covariance)))

    def on_step(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what a step did."""
        values = conversions.status_values(message, "slam_step")
        row, latency_ms, number = row_from_values(values)
        step = (row, raw, latency_ms, number, changes_from_values(values))
        stamp = decoding.stamp_of(message.header)
        self._take_step(stamp, self._pairs.add(1, stamp, step))

    def _take_step(self, stamp: int, pair: tuple[Any, Any] | None) -> None:
        if pair is None:
            return
        step: _Step = (*pair[0], *pair[1])
        if self._ending is None or self._player.is_there:
            self._add_steps([step])
        else:
            self._add_steps(self._ending.take(stamp, step))

    def _add_steps(self, steps: list[_Step]) -> None:
        for pose, covariance, row, raw_row, latency_ms, number, changes in steps:
            first_of_pass = bool(row["first_of_pass"])
            if not first_of_pass and self._recorded.has(number, pose.stamp):
                self.monitor.refuse(Refusal.DUPLICATE, stamp=pose.stamp)
                continue
            if not (self._recorded.count or self._player.is_there) and number > 1:
                self._ledger.join()
            self.recording.add_step(pose, covariance, row, raw_row, latency_ms=latency_ms)
            self.recording.add_changes(pose.stamp, "slam_node", changes)
            self._recorded.add(number, pose.stamp, first_of_pass=first_of_pass)
            self._steps += 1
            self._last_progress = time.monotonic()
            self._query.ask()

    def _refuse_unpaired(self, _stream: int, stamp: int) -> None:
        self.monitor.refuse(Refusal.UNPAIRED, stamp=stamp)

    def on_gyro_bias(self, _message: Vector3Stamped, raw: Raw) -> None:
        """Take the gyroscope's bias; what a step's status says of it goes into the summary."""
        self.recording.add_other(raw)

    def on_prediction(self, message: Odometry, raw: Raw) -> None:
        """Take a predicted pose."""
        self.recording.add_prediction(_pose(message, raw))

    def on_calibration(self, topic: Topic, message: Any, raw: Raw) -> None:
        """Take a camera info or the extrinsics, which viewers know as a static transform."""
        self.recording.add_latched(raw)
        if topic is EXTRINSICS:
            made = static_transform(*decoding.transform(message))
            self.recording.add_latched(Raw(made.topic, made.data))

    def on_landmarks(self, message: PointCloud2, raw: Raw) -> None:
        """Take a map; of one that ends the recording, only that."""
        stamp = decoding.stamp_of(message.header)
        if self._ending is None or self._ending.last in (None, stamp):
            self.recording.add_landmarks(stamp, conversions.landmarks_from_message(message), raw)

    def _on_map_request(self, stamp: int) -> None:
        """Take as of which step slam_node has published the map that was asked for."""
        if self._ending is not None:
            last = self.recording.last_stamp
            self._add_steps(self._ending.end_at(stamp, last, time.monotonic()))

    def on_player(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take the player's state and how much it has sent."""
        if self._player.take(message):
            self._last_progress = time.monotonic()
        if self._ledger.set_sent(self._player.sent):
            self._steps = 0  # another player has begun
        if any(self._player.sent.get(topic.name) for topic in IMAGES):
            self._query.expect(TRACKER)
        self.recording.add_other(raw)

    def on_diagnostics(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what the nodes of this namespace report of themselves."""
        self.recording.add_other(raw)
        for entry in message.status:
            node = neighbour(self, entry.name)
            if node not in (*QUERIED, TRACKER):
                continue
            values = {value.key: value.value for value in entry.values}
            if node == "slam_node":
                self._heard_slam_node = time.monotonic()
                peak_rss_mb, resets = process_from_values(values)
                self.recording.set_process(peak_rss_mb=peak_rss_mb, resets=resets)
                for which in (PREVIOUS, PRESENT):
                    if (judgement := verdict_from_values(values, which)) is not None:
                        self.recording.set_verdict(judgement)
            if self._ledger.set_report(node, NodeReport.of_values(values)):
                self._last_progress = time.monotonic()
            self.recording.set_refused(*self._ledger.refused(at_end=False))

    def on_tick(self) -> None:
        """Keep the files up to date, and bring the run to its end when that has come."""
        self.recording.refresh()
        if self.recording.finished:
            return
        now = time.monotonic()
        if not self._is_over(now):
            self._waiting_since = None
            return
        self._waiting_since = self._waiting_since or now
        self._query.ask()
        if self._may_ask_for_map():
            self._map.ask(self.recording.last_stamp)
        if self._is_done(now, now - self._waiting_since):
            self._conclude()

    def _is_over(self, now: float) -> bool:
        """Whether nothing is to come but the map and the nodes' parameters."""
        if not self._player.has_ended:
            return self._ending is not None
        if self._ledger.is_settled(self._steps) or self._is_quiet(now):
            return True
        return now - self._last_progress >= GRACE_SECONDS

    def _may_ask_for_map(self) -> bool:
        """Whether the map is to be the exact one of the last step.

        While a player is at work there is none: whoever ends the recorder ends the run.
        """
        if self._ending is None or self._player.has_ended:
            return True
        return not self._player.is_there and self._ending.last is None

    def _is_done(self, now: float, waited: float) -> bool:
        """Whether these are here, or need not be waited for any longer (s)."""
        is_stopped = self._ending is not None and self._player.is_there
        if is_stopped and not self._is_quiet(now):
            return False
        if is_stopped and not self._player.has_ended:
            return True
        map_may_come = self._map.is_possible and not self._map.failed
        if self._ending is not None and (self._ending.is_missed or not map_may_come):
            return self._is_quiet(now)
        # A map that slam_node publishes by itself is not the exact one.
        has_map = self.recording.has_final_map and (self._map.answered or not map_may_come)
        if has_map or not (self._steps or self._ending):
            return self._query.complete or waited > ANSWER_SECONDS
        if self._ending is not None and self._heard_slam_node < now - waited:
            return waited > (ANSWER_SECONDS if self._player.state == "absent" else SILENCE_SECONDS)
        return waited > (self.recording.map_patience if map_may_come else ANSWER_SECONDS)

    def _is_quiet(self, now: float) -> bool:
        """Whether the recorder was told to end and nothing comes any more."""
        return self._ending is not None and self._ending.is_quiet(now)

    def _conclude(self) -> None:
        """Close the files and say how the run ended."""
        recording = self.recording
        if self._ending is not None:
            self._add_steps(self._ending.end_here())
        reason = self._shortfall()
        ended = self._player.state == "finished"
        recording.set_refused(*self._ledger.refused(at_end=ended))
        recording.finish(complete=not reason, reason=reason)
        self.get_logger().info(
            f"{recording.directory}: {f'incomplete: {reason}' if reason else 'complete'}"
        )
        if note := recording.note_on_passes:
            self.get_logger().info(note)

    def _shortfall(self) -> str | None:
        """What keeps the run from being whole."""
        if self._player.state == "interrupted":
            return PLAYER_INTERRUPTED
        if self._player.state == "finished":
            reason = self._ledger.shortfall(self._steps)
        elif self._player.state == "absent":
            cut = self._ending is not None and self._ending.last is not None
            reason = self._ledger.gap(self._recorded, to_the_end=not cut)
        else:
            reason = self._stopped()
        missing = None if self.recording.has_final_map else "the landmark map did not arrive"
        return reason or missing

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        self._parameters_of[node] = values
        if not self.recording.finished:
            self.recording.set_parameters(dict(sorted(self._parameters_of.items())))

    def flush(self) -> str:
        """Bring all files up to date."""
        self.recording.flush()
        return f"{self._steps} steps in {self.recording.directory}"

    def finish(self) -> str:
        """Begin to end the recording as it stands, and then this node."""
        if self._ending is None:
            self._ending = Ending(time.monotonic(), self.monitor.inputs)
            # Said at once, so that whoever sends may end before it.
            self.recording.announce_end(self._stopped())
        return (
            f"{self.recording.directory} will hold {self._steps} steps or more: see summary.json"
        )

    @property
    def is_told_to_end(self) -> bool:
        """Whether the recording is to end, by :meth:`finish` or by a signal."""
        return self._ending is not None

    def wind_up(self, *, hurried: bool) -> bool:
        """End the recording; tell whether it has. Hurried, it ends with what has come."""
        self.finish()
        is_empty, self._winds_up = self._winds_up, True
        if is_empty and hurried and not self.recording.finished:
            self._conclude()
        elif is_empty and self._ending is not None:
            names = (self.resolve_topic_name(topic.name) for topic in (ODOMETRY, PREDICTION))
            more_may_come = any(map(self.count_publishers, names))
            inputs = self.monitor.inputs
            self._ending.note_empty(time.monotonic(), inputs, more_may_come=more_may_come)
        return self.recording.finished

    def _describe(self) -> tuple[str, dict[str, object]]:
        activity = "ending" if self.is_told_to_end else "recording"
        return "finished" if self.recording.finished else activity, {
            "steps": self._steps,
            "features sent": self._ledger.features_sent,
            "player": self._player.state,
            "directory": str(self.recording.directory),
        }

    def _stopped(self) -> str:
        what = "the recorder could not go on" if self._ending is None else STOPPED
        return f"{what} while the player was {self._player.state}"

    def destroy_node(self) -> None:
        """Close the files; a run that has not ended is marked as incomplete."""
        try:
            if self._ending is not None:
                self._add_steps(self._ending.end_here())
            self.recording.finish(complete=False, reason=self._stopped())
        finally:
            super().destroy_node()


def _pose(message: Odometry, raw: Raw) -> Pose:
    frames = message.header.frame_id, message.child_frame_id
    return Pose(*decoding.pose(message), raw, *frames)


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    # What it hears is kept until it comes to it; an estimate that waits for it is late.
    os.nice(_NICENESS)
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
