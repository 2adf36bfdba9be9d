# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a recorder hears, given to its callbacks."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from rclpy.task import Future

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import SlamStep
from vislam_ros.data.bags.layout import (
    DIAGNOSTICS,
    FEATURES,
    GYRO_BIAS,
    LANDMARKS,
    ODOMETRY,
    PLAYER,
    PREDICTION,
    STEPS,
    TWIST,
    Topic,
)
from vislam_ros.data.results.recording import Raw
from vislam_ros.nodes import conversions
from vislam_ros.nodes.recorder_node import RecorderNode
from vislam_ros.nodes.slam_report import step_values


def give(callback: Callable[..., None], topic: Topic, message: Any) -> None:
    callback(message, Raw(topic, serialize_message(message)))


def give_step(
    recorder: RecorderNode, step: SlamStep, first_of_pass: bool | None = None, number: int = 1
) -> None:
    odometry = conversions.odometry(
        step.stamp, "map", "base_link", step.position, step.quaternion, step.covariance
    )
    row = step.row()
    if first_of_pass is not None:
        row["first_of_pass"] = first_of_pass
    values = step_values(row, latency_ms=1.5, number=number)
    give(recorder.on_odometry, ODOMETRY, odometry)
    if step.estimates:
        bias = conversions.vector3_stamped(
            step.stamp, "base_link", np.asarray(step.estimates[0].values)
        )
        give(recorder.on_gyro_bias, GYRO_BIAS, bias)
    give(
        recorder.on_step,
        STEPS,
        conversions.status_array(odometry.header.stamp, [conversions.status("slam_step", values)]),
    )


def give_map(recorder: RecorderNode, stamp: int, landmarks: LandmarkMap) -> None:
    give(
        recorder.on_landmarks,
        LANDMARKS,
        conversions.landmarks_to_message(stamp, "map", landmarks),
    )


def give_player(recorder: RecorderNode, state: str, sent: int) -> None:
    values = {"state": state, f"sent {FEATURES.name}": sent, f"sent {TWIST.name}": sent}
    message = conversions.status_array(
        conversions.stamp_to_message(0), [conversions.status("player", values)]
    )
    give(recorder.on_player, PLAYER, message)


def give_drive(recorder: RecorderNode, drive: Any, answers: tuple[list[SlamStep], Any]) -> None:
    for k, (prediction, step) in enumerate(zip(drive.predictions, answers[0], strict=True)):
        give(recorder.on_prediction, PREDICTION, prediction)
        give_step(recorder, step, number=k + 1)


def tick_until_finished(recorder: RecorderNode) -> None:
    deadline = time.monotonic() + 20
    while not recorder.recording.finished and time.monotonic() < deadline:
        recorder.on_tick()
        if recorder.is_told_to_end:
            recorder.wind_up(hurried=False)  # nothing waits here
        time.sleep(0.01)
    assert recorder.recording.finished


def give_slam_report(recorder: RecorderNode, **values: object) -> None:
    """What slam_node says of itself on /diagnostics."""
    told: dict[str, object] = {"peak memory [MB]": 81.5, "resets": 0} | values
    status = conversions.status("/slam_node", told)
    message = conversions.status_array(conversions.stamp_to_message(0), [status])
    give(recorder.on_diagnostics, DIAGNOSTICS, message)


def answer_later(asked: list[Future]) -> Future:
    """Note a request, whose answer the test gives."""
    asked.append(Future())
    return asked[-1]


def summary(directory: Path) -> dict[str, Any]:
    return dict(json.loads((directory / "summary.json").read_text()))
