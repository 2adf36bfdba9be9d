# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The recorder: writes what the graph answers as a result directory, and knows when it is whole.

A run is whole when the player says that it has finished, each features message it sent was
answered by a step, and the map of the last step is on disk.
"""

import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from vislam_ros.data.bags.layout import LATCHED_QOS, STREAM_QOS, Topic
from vislam_ros.data.results.recording import Pose, Raw, Recording
from vislam_ros.errors import SettingsError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.conversions import MessageError
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.parameter_query import ParameterQuery
from vislam_ros.nodes.parameters import declare_settings, warn_of_undeclared_overrides
from vislam_ros.nodes.qos import LATCHED, STREAM
from vislam_ros.nodes.settings import RecorderSettings
from vislam_ros.nodes.slam_report import row_from_values
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.stamp_pairs import StampPairs

ODOMETRY = Topic("slam/odometry", "nav_msgs/msg/Odometry", STREAM_QOS)
STEPS = Topic("slam/steps", "diagnostic_msgs/msg/DiagnosticArray", STREAM_QOS)
GYRO_BIAS = Topic("slam/gyro_bias", "geometry_msgs/msg/Vector3Stamped", STREAM_QOS)
PREDICTION = Topic("prediction/odometry", "nav_msgs/msg/Odometry", STREAM_QOS)
LANDMARKS = Topic("slam/landmarks", "sensor_msgs/msg/PointCloud2", LATCHED_QOS)
PLAYER = Topic("player/status", "diagnostic_msgs/msg/DiagnosticArray", LATCHED_QOS)
DIAGNOSTICS = Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", STREAM_QOS)

GRACE_SECONDS = 5.0
"""How long the recorder waits without progress for steps that the player's count promises."""

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
        self._player_state = "absent"
        self._features_sent = 0
        self._steps = 0
        self._last_progress = time.monotonic()
        self._waiting_since: float | None = None
        self._map_asked_for: int | None = None
        self._refused: dict[str, dict[str, int]] = {}
        self._pairs = StampPairs()
        own = {field.name: getattr(settings, field.name) for field in fields(RecorderSettings)}
        self._parameters: dict[str, dict[str, Any]] = {"recorder_node": own}
        self._map_client = self.create_client(Trigger, "slam_node/publish_landmarks")
        self.monitor = Monitor(self, self._describe)
        on_parameters = self.monitor.guard("parameters", self._on_parameters)
        self._query = ParameterQuery(self, QUERIED, on_parameters)
        self._record(ODOMETRY, Odometry, self.on_odometry)
        self._record(STEPS, DiagnosticArray, self.on_step)
        self._record(GYRO_BIAS, Vector3Stamped, self.on_gyro_bias)
        self._record(PREDICTION, Odometry, self.on_prediction)
        self._record(LANDMARKS, PointCloud2, self.on_landmarks)
        self._record(PLAYER, DiagnosticArray, self.on_player)
        self._record(DIAGNOSTICS, DiagnosticArray, self.on_diagnostics)
        self.monitor.serve("~/flush", self.flush)
        self.create_timer(_TICK_SECONDS, self.monitor.guard("timer", self.on_tick))

    def _record(
        self, topic: Topic, message_type: type, callback: Callable[[Any, Raw], None]
    ) -> None:
        """Subscribe to serialised messages, so that they are kept as they came."""

        def on_raw(data: bytes) -> None:
            callback(deserialize_message(data, message_type), Raw(topic, data))

        self.monitor.subscribe(
            message_type,
            "/diagnostics" if topic is DIAGNOSTICS else topic.name,
            on_raw,
            qos_profile=LATCHED if topic.qos == LATCHED_QOS else STREAM,
            raw=True,
        )

    def on_odometry(self, message: Odometry, raw: Raw) -> None:
        """Take the pose of a step."""
        pose = Pose(*conversions.pose_from_odometry(message), raw)
        covariance = conversions.covariance_from_odometry(message)
        self._add_step(pose.stamp, self._pairs.add(0, pose.stamp, (pose, covariance)))

    def on_step(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what a step did."""
        row, latency_ms = row_from_values(conversions.status_values(message, "slam_step"))
        stamp = conversions.stamp_from_message(message.header.stamp)
        self._add_step(stamp, self._pairs.add(1, stamp, (row, latency_ms, raw)))

    def _add_step(self, stamp: int, pair: tuple[Any, Any] | None) -> None:
        self.monitor.absorb("pairs", Counter(unpaired=self._pairs.unpaired))
        if pair is None:
            return
        (pose, covariance), (row, latency_ms, raw_row) = pair
        self.recording.add_step(pose, covariance, row, raw_row, latency_ms=latency_ms)
        self._steps += 1
        self._last_progress = time.monotonic()
        self._query.ask()

    def on_gyro_bias(self, _message: Vector3Stamped, raw: Raw) -> None:
        """Take the gyroscope's bias; what a step's status says of it goes into the summary."""
        self.recording.add_other(raw)

    def on_prediction(self, message: Odometry, raw: Raw) -> None:
        """Take a predicted pose."""
        self.recording.add_prediction(Pose(*conversions.pose_from_odometry(message), raw))

    def on_landmarks(self, message: PointCloud2, raw: Raw) -> None:
        """Take a map."""
        stamp = conversions.stamp_from_message(message.header.stamp)
        self.recording.add_landmarks(stamp, conversions.landmarks_from_message(message), raw)

    def on_player(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take the player's state and how much it has sent."""
        values = conversions.status_values(message, "player")
        try:
            state, sent = values["state"], int(values["features_sent"])
        except (KeyError, ValueError) as error:
            raise MessageError("bad_fields", f"player/status: {error}") from error
        if sent < self._features_sent:
            self._steps = 0  # another player has begun
        if (state, sent) != (self._player_state, self._features_sent):
            self._last_progress = time.monotonic()
        self._player_state, self._features_sent = state, sent
        self.recording.add_other(raw)

    def on_diagnostics(self, message: DiagnosticArray, raw: Raw) -> None:
        """Take what the nodes report of themselves."""
        self.recording.add_other(raw)
        for entry in message.status:
            values = {value.key: value.value for value in entry.values}
            node = entry.name.rpartition("/")[2]
            refused = {
                key.removeprefix("refused "): int(value)
                for key, value in values.items()
                if key.startswith("refused ")
            }
            if node == "slam_node":
                self.recording.set_process(
                    peak_rss_mb=float(values["peak memory [MB]"]), resets=int(values["resets"])
                )
                self._refused[""] = refused
            elif node == "imu_prediction_node":
                self._refused["twist_"] = refused
            else:
                continue
            self.recording.set_refused(
                {
                    prefix + reason: count
                    for prefix, counts in sorted(self._refused.items())
                    for reason, count in counts.items()
                }
            )

    def on_tick(self) -> None:
        """Keep the files up to date and, when the player has ended, bring the run to its end."""
        recording, now = self.recording, time.monotonic()
        recording.refresh()
        if recording.finished or self._player_state not in ("finished", "interrupted"):
            self._waiting_since = None
            return
        if self._steps < self._features_sent and now - self._last_progress < GRACE_SECONDS:
            return
        self._waiting_since = self._waiting_since or now
        self._query.ask()
        self._ask_for_map()
        answered = recording.has_final_map and self._query.complete
        map_may_come = not recording.has_final_map and self._map_client.service_is_ready()
        patience = recording.map_patience if map_may_come else ANSWER_SECONDS
        if answered or now - self._waiting_since > patience:
            reason = self._shortfall()
            recording.finish(complete=not reason, reason=reason)
            self.get_logger().info(
                f"{recording.directory}: {f'incomplete: {reason}' if reason else 'complete'}"
            )

    def _ask_for_map(self) -> None:
        """Ask for the map of the last step, once for each."""
        wanted = self.recording.last_stamp
        if wanted != self._map_asked_for and self._map_client.service_is_ready():
            self._map_asked_for = wanted
            self._map_client.call_async(Trigger.Request())

    def _shortfall(self) -> str | None:
        """What keeps the run from being whole."""
        if self._player_state == "interrupted":
            return "the player was interrupted"
        if self._steps != self._features_sent:
            return f"{self._steps} steps for {self._features_sent} features messages"
        if not self._steps:
            return "the player sent no features"
        if not self.recording.has_final_map:
            return "the landmark map did not arrive"
        return None

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
            "features sent": self._features_sent,
            "player": self._player_state,
            "directory": str(self.recording.directory),
        }

    def destroy_node(self) -> None:
        """Close the files; a run that has not ended is marked as incomplete."""
        reason = f"the recorder was stopped while the player was {self._player_state}"
        self.recording.finish(complete=False, reason=reason)
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
