# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""SLAM as a node: predicted poses and stereo features in, poses and landmarks in the map out."""

import functools
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import threadpoolctl
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, PointCloud2

from vislam_ros.core.filters.quantities import GYRO_BIAS
from vislam_ros.core.filters.registry import estimator_named
from vislam_ros.core.filters.settings import GivenMapSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.step import SlamStep
from vislam_ros.data.bags import decoding, layout
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS, Calibration, differences
from vislam_ros.data.bags.layout import Topic
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.errors import VislamError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.parameters import (
    declare_settings,
    declare_slam_settings,
    estimator_overrides,
    warn_of_undeclared_overrides,
)
from vislam_ros.nodes.recorder.map_request import map_answer
from vislam_ros.nodes.recorder.parameter_changes import ParameterChanges
from vislam_ros.nodes.settings import SlamNodeSettings, SlamOutputSettings
from vislam_ros.nodes.slam_report import SlamReport, step_values
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.tf import TransformSender


class SlamNode(Node):
    """Owns ``map_frame -> odom_frame``; one ``slam/odometry`` for each features message."""

    def __init__(self, **options: Any):
        super().__init__("slam_node", **options)
        self._settings = declare_settings(self, SlamNodeSettings)
        self._changes = ParameterChanges(self.get_logger())
        self._output = declare_settings(self, SlamOutputSettings, self._change_output)
        slam_settings = declare_slam_settings(
            self, self._change_settings, lambda settings: self.core.require_possible(settings)
        )
        given_map = None
        if isinstance(slam_settings, GivenMapSettings) and slam_settings.map_file:
            given_map = read_landmarks(Path(slam_settings.map_file))
        smoothable = estimator_named(slam_settings.estimator).smoothable
        record = self._settings.exact_map and smoothable
        self.core = Slam(slam_settings, given_map, record=record)
        self._frames = layout.Frames(
            self._settings.map_frame,
            self._settings.odom_frame,
            self._settings.base_frame,
            self._settings.camera_frame,
        )
        self._calibration = Calibration(self._frames)
        self._received_at: dict[int, float] = {}
        self._last_stamp: int | None = None
        self._landmarks_published: tuple[int, float] | None = None  # data stamp, clock
        self._published_stamp: int | None = None
        self._path: deque[Any] = deque(maxlen=self._output.path_length)
        self._report = SlamReport(self, self.core)
        self.monitor = Monitor(self, self._describe, self._report.warning)
        self._tf = TransformSender(self, self.monitor)
        self._odometry = self.monitor.advertise(layout.ODOMETRY)
        self._steps = self.monitor.advertise(layout.STEPS)
        self._gyro_bias = self.monitor.advertise(layout.GYRO_BIAS)
        self._landmarks = self.monitor.advertise(layout.LANDMARKS)
        self._paths = self.monitor.advertise(layout.PATH)
        for topic in CALIBRATION_TOPICS:
            self.monitor.subscribe(topic, functools.partial(self.on_calibration, topic))
        self.monitor.subscribe(layout.PREDICTION, self.on_prediction)
        self.monitor.subscribe(layout.FEATURES, self.on_features)
        self.monitor.serve("~/reset", self.reset)
        self.monitor.serve("~/publish_landmarks", self.publish_landmarks)
        warn_of_undeclared_overrides(self, known=estimator_overrides(self))

    def on_calibration(self, topic: Topic, message: CameraInfo | TransformStamped) -> None:
        """Take a camera info or the extrinsics."""
        before = self._calibration.camera
        camera = self._calibration.add(topic, message)
        if camera is None:
            return
        if before is not None:
            when = "the next pass or reset" if self.core.has_begun else "the first frame"
            self.get_logger().warning(
                f"the calibration changed ({differences(before, camera)}): it holds from {when} on"
            )
        self._publish(self.core.set_camera(camera, self._calibration.rectification))

    def on_prediction(self, message: Odometry) -> None:
        """Take a predicted pose."""
        stamp, position, quaternion, known = decoding.prediction(message, self._frames)
        self._publish(self.core.add_prediction(stamp, position, quaternion, velocity_known=known))

    def on_features(self, message: PointCloud2) -> None:
        """Take the features of one stamp."""
        received_at = time.monotonic()
        stamp, ids, pixels, noise = decoding.features(message, self._frames)
        self._received_at.setdefault(stamp, received_at)
        self._publish(self.core.add_features(stamp, ids, pixels, noise))

    def _publish(self, steps: list[SlamStep]) -> None:
        """Publish what the core has answered."""
        self.monitor.absorb("core", self.core.refused)
        for step in steps:
            if step.first_of_pass:
                self._begin_pass()
            self._publish_step(step)
        if not self.core.waiting:
            self._received_at.clear()

    def _begin_pass(self) -> None:
        """Publish the verdict and the map that the last pass ended with, for a recorder."""
        if self._last_stamp is not None:
            self.monitor.report()
        if self._last_stamp is not None and self.core.previous_map is not None:
            self._publish_landmarks(self._last_stamp, self.core.previous_map)
        self._landmarks_published = None
        self._path.clear()

    def _publish_step(self, step: SlamStep) -> None:
        settings, output = self._settings, self._output
        odometry = conversions.odometry(
            step.stamp,
            settings.map_frame,
            settings.base_frame,
            step.position,
            step.quaternion,
            step.covariance,
            step.twist,
            step.twist_covariance,
        )
        now = time.monotonic()
        latency_ms = 1e3 * (now - self._received_at.pop(step.stamp, now))
        row = step.row()
        self._report.add(step, row)
        # Before the pose: the recorder writes both or none, and a node that is killed between the
        # two has told no pose that is in no file.
        self.monitor.publish(
            self._steps,
            conversions.status_array(
                odometry.header.stamp,
                [
                    conversions.status(
                        "slam_step",
                        step_values(row, latency_ms, self._report.steps, self._changes.take()),
                    )
                ],
                settings.map_frame,
            ),
        )
        self.monitor.publish(self._odometry, odometry)
        for estimate in step.estimates:
            if estimate.quantity == GYRO_BIAS:
                bias = np.asarray(estimate.values)
                message = conversions.vector3_stamped(step.stamp, settings.base_frame, bias)
                self.monitor.publish(self._gyro_bias, message)
        if output.publish_tf and self._tf.is_heard:
            self._tf.send(
                conversions.transform(
                    step.stamp,
                    settings.map_frame,
                    settings.odom_frame,
                    step.T_map_odom[:3, 3],
                    se3.quaternion_from_rotation(step.T_map_odom[:3, :3]),
                )
            )
        if output.path_length:
            self._path.append((step.stamp, step.position, step.quaternion))
        self._last_stamp = step.stamp
        if self._is_time_for_landmarks(step.stamp, now):
            self._publish_landmarks(step.stamp, self.core.landmarks())
            self._publish_path(step.stamp)

    def _is_time_for_landmarks(self, stamp: int, now: float) -> bool:
        """Tell whether the period has passed both in the data and by the clock."""
        period = self._output.landmarks_period
        if self._landmarks_published is None:
            # The first map of a pass is a period away, like every later one.
            self._landmarks_published = (stamp, now)
        last_stamp, last_time = self._landmarks_published
        return period > 0 and min((stamp - last_stamp) * 1e-9, now - last_time) >= period

    def _publish_landmarks(self, stamp: int, landmarks: LandmarkMap) -> None:
        message = conversions.landmarks_to_message(stamp, self._settings.map_frame, landmarks)
        self.monitor.publish(self._landmarks, message)
        self._landmarks_published = (stamp, time.monotonic())
        self._published_stamp = stamp

    def _publish_path(self, stamp: int) -> None:
        if self._output.path_length and self._paths.get_subscription_count():
            frame = self._settings.map_frame
            poses = [conversions.pose_stamped(stamp, frame, p, q) for stamp, p, q in self._path]
            self.monitor.publish(self._paths, conversions.path(stamp, frame, poses))

    def reset(self) -> str:
        """Begin the estimate anew with the next features."""
        self.core.reset()
        self._publish([])
        return "the estimate begins anew"

    def publish_landmarks(self) -> str:
        """Publish the map, the exact one where it is recorded, and the path as of the last step.

        The way back over a long drive takes seconds, in which the node answers nothing else.
        """
        if self._last_stamp is None:
            raise VislamError("there was no step yet")
        self.monitor.report()  # who asked may wonder whether there is anybody
        landmarks = self.core.best_landmarks()
        self._publish_landmarks(self._last_stamp, landmarks)
        self._publish_path(self._last_stamp)
        self.monitor.report()
        return map_answer(len(landmarks), self._last_stamp)

    def wind_up(self, *, hurried: bool) -> bool:
        """Leave the map and the counts as they stand, which nobody can ask for any more."""
        if self._last_stamp is not None and self._published_stamp != self._last_stamp:
            self._publish_landmarks(self._last_stamp, self.core.landmarks())
        self.monitor.report()
        return True

    def _change_settings(self, settings: SlamSettings) -> None:
        self._changes.note(self.core.settings, settings)
        self.core.change_settings(settings)

    def _change_output(self, output: SlamOutputSettings) -> None:
        self._changes.note(self._output, output)
        self._output = output
        self._path = deque(self._path, maxlen=output.path_length)

    def _describe(self) -> tuple[str, dict[str, object]]:
        if missing := self._calibration.missing():
            activity = f"waiting for calibration: {', '.join(missing)}"
        elif self._last_stamp is None:
            activity = "waiting for features and predictions"
        else:
            activity = "running"
        return activity, self._report.values()


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    # The matrices are small: a second thread costs more than it brings, and much at worst.
    threadpoolctl.threadpool_limits(1)
    return run(SlamNode, args)


if __name__ == "__main__":
    sys.exit(main())
