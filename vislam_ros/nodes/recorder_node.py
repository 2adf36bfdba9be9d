# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder: writes what the graph answers as a result directory, and knows when it is whole.

A run ends when the player says that it has finished, and all that it has sent has arrived and
come to something: see :mod:`vislam_ros.data.results.completeness`.
"""

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
from std_srvs.srv import Trigger

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.core.tracking.stamp_pairs import StampPairs
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    GYRO_BIAS,
    LANDMARKS,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    STEPS,
    Topic,
)
from vislam_ros.data.results.completeness import Ledger, NodeReport, counts_from_values
from vislam_ros.data.results.recording import Pose, Raw, Recording
from vislam_ros.errors import SettingsError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.parameter_query import ParameterQuery
from vislam_ros.nodes.parameters import (
    declare_settings,
    warn_of_undeclared_overrides,
)
from vislam_ros.nodes.settings import RecorderSettings
from vislam_ros.nodes.slam_report import (
    PRESENT,
    PREVIOUS,
    row_from_values,
    verdict_from_values,
)
from vislam_ros.nodes.spin import run

GRACE_SECONDS = 5.0
"""How long the recorder waits without progress for what the player has sent."""

ANSWER_SECONDS = 5.0
"""How long it waits for the nodes' parameters, and for the map where nobody offers one."""

QUERIED = ("imu_prediction_node", "slam_node")
"""Nodes whose parameters go into ``params.yaml``."""

_TICK_SECONDS = 0.2


class RecorderNode(Node):
    """Node ``recorder_node``; its files are closed by ``destroy_node``."""

    def __init__(self, **options: Any):
        super().__init__("recorder_node", **options)
        settings = declare_settings(self, RecorderSettings)
        warn_of_undeclared_overrides(self)
        if not settings.directory:
            raise SettingsError("directory: is not set: give the result directory to write")
        self.recording = Recording(
            Path(settings.directory), force=settings.force, record_mcap=settings.record_mcap
        )
        self._player: tuple[str, dict[str, int]] = ("absent", {})
        self._ledger = Ledger()
        self._steps = 0
        self._last_progress = time.monotonic()
        self._waiting_since: float | None = None
        self._map_asked_for: int | None = None
        self._pairs = StampPairs(self._refuse_unpaired)
        own = {field.name: getattr(settings, field.name) for field in fields(RecorderSettings)}
        self._parameters: dict[str, dict[str, Any]] = {"recorder_node": own}
        self._map_client = self.create_client(Trigger, "slam_node/publish_landmarks")
        self.monitor = Monitor(self, self._describe)
        on_parameters = self.monitor.guard("parameters", self._on_parameters)
        self._query = ParameterQuery(self, QUERIED, on_parameters)
        self._record(ODOMETRY, self.on_odometry)
        self._record(STEPS, self.on_step)
        self._record(GYRO_BIAS, self.on_gyro_bias)
        self._record(PREDICTION, self.on_prediction)
        self._record(LANDMARKS, self.on_landmarks)
        self._record(PLAYER, self.on_player)
        self._record(DIAGNOSTICS, self.on_diagnostics)
        self.monitor.serve("~/flush", self.flush)
        self.create_timer(_TICK_SECONDS, self.monitor.guard("timer", self.on_tick))

    def _record(self, topic: Topic, callback: Callable[[Any, Raw], None]) -> None:
        """Subscribe, keeping the messages' bytes as they came."""

        def on_message(message: Any, data: bytes) -> None:
            callback(message, Raw(topic, data))

        self.monitor.subscribe(topic, on_message, with_data=True)

    def on_odometry(self, message: Odometry, raw: Raw) -> None:
        """Take the pose of a step."""
        pose = Pose(*decoding.pose(message), raw)
        covariance = conversions.covariance_from_odometry(message)
        self._add_step(pose.stamp, self._pairs.add(0, pose.stamp, (pose, covariance)))

    def on_step(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what a step did."""
        row, latency_ms = row_from_values(conversions.status_values(message, "slam_step"))
        stamp = decoding.stamp_of(message.header)
        self._add_step(stamp, self._pairs.add(1, stamp, (row, latency_ms, raw)))

    def _add_step(self, stamp: int, pair: tuple[Any, Any] | None) -> None:
        if pair is None:
            return
        (pose, covariance), (row, latency_ms, raw_row) = pair
        self.recording.add_step(pose, covariance, row, raw_row, latency_ms=latency_ms)
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
        self.recording.add_prediction(Pose(*decoding.pose(message), raw))

    def on_landmarks(self, message: PointCloud2, raw: Raw) -> None:
        """Take a map."""
        stamp = decoding.stamp_of(message.header)
        self.recording.add_landmarks(stamp, conversions.landmarks_from_message(message), raw)

    def on_player(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take the player's state and how much it has sent."""
        values = conversions.status_values(message, "player")
        try:
            state, sent = values["state"], counts_from_values(values, "sent ")
        except (KeyError, ValueError) as error:
            raise RefusedMessage(Refusal.BAD_FIELDS, f"{PLAYER.name}: {error!r}") from error
        if self._ledger.set_sent(sent):
            self._steps = 0  # another player has begun
        if (state, sent) != self._player:
            self._last_progress = time.monotonic()
        self._player = state, sent
        self.recording.add_other(raw)

    def on_diagnostics(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what the nodes report of themselves."""
        self.recording.add_other(raw)
        for entry in message.status:
            values = {value.key: value.value for value in entry.values}
            node = entry.name.rpartition("/")[2]
            if node not in QUERIED:
                continue
            if node == "slam_node":
                self.recording.set_process(
                    peak_rss_mb=float(values["peak memory [MB]"]), resets=int(values["resets"])
                )
                for which in (PREVIOUS, PRESENT):
                    if (judgement := verdict_from_values(values, which)) is not None:
                        self.recording.set_verdict(judgement)
            if self._ledger.set_report(node, NodeReport.of_values(values)):
                self._last_progress = time.monotonic()
            self.recording.set_refused(*self._ledger.refused(at_end=False))

    def on_tick(self) -> None:
        """Keep the files up to date and, when the player has ended, bring the run to its end."""
        recording, now = self.recording, time.monotonic()
        recording.refresh()
        if recording.finished or self._player[0] not in ("finished", "interrupted"):
            self._waiting_since = None
            return
        if not self._ledger.is_settled(self._steps) and now - self._last_progress < GRACE_SECONDS:
            return
        self._waiting_since = self._waiting_since or now
        self._query.ask()
        self._ask_for_map()
        has_map = recording.has_final_map or not self._steps
        map_may_come = not has_map and self._map_client.service_is_ready()
        patience = recording.map_patience if map_may_come else ANSWER_SECONDS
        if (has_map and self._query.complete) or now - self._waiting_since > patience:
            reason = self._shortfall()
            ended = self._player[0] == "finished"
            recording.set_refused(*self._ledger.refused(at_end=ended))
            recording.finish(complete=not reason, reason=reason)
            self.get_logger().info(
                f"{recording.directory}: {f'incomplete: {reason}' if reason else 'complete'}"
            )

    def _ask_for_map(self) -> None:
        """Ask for the map of the last step, once for each."""
        wanted = self.recording.last_stamp
        if wanted not in (None, self._map_asked_for) and self._map_client.service_is_ready():
            self._map_asked_for = wanted
            self._map_client.call_async(Trigger.Request())

    def _shortfall(self) -> str | None:
        """What keeps the run from being whole."""
        if self._player[0] == "interrupted":
            return "the player was interrupted"
        if reason := self._ledger.shortfall(self._steps):
            return reason
        return None if self.recording.has_final_map else "the landmark map did not arrive"

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        self._parameters[node] = values
        if not self.recording.finished:
            self.recording.set_parameters(dict(sorted(self._parameters.items())))

    def flush(self) -> str:
        """Bring all files up to date."""
        self.recording.flush()
        return f"{self._steps} steps in {self.recording.directory}"

    def _describe(self) -> tuple[str, dict[str, object]]:
        finished = self.recording.finished
        return "finished" if finished else "recording", {
            "steps": self._steps,
            "features sent": self._ledger.features_sent,
            "player": self._player[0],
            "directory": str(self.recording.directory),
        }

    def destroy_node(self) -> None:
        """Close the files; a run that has not ended is marked as incomplete."""
        reason = f"the recorder was stopped while the player was {self._player[0]}"
        self.recording.finish(complete=False, reason=reason)
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
