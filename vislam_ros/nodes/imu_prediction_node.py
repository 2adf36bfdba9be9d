# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning as a node: ``imu/twist`` or ``imu/data`` in, ``prediction/odometry`` out."""

import sys
from typing import Any, TypeAlias

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Imu

from vislam_ros.core.filters.dead_reckoning import DeadReckoning, Prediction
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.core.tracking.refusals import Refusal, Stream
from vislam_ros.core.tracking.stamp_pairs import StampPairs
from vislam_ros.core.tracking.time_order import Passes
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import IMU, PREDICTION, TWIST, Frames
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor, stamp_age, values_if_over
from vislam_ros.nodes.parameters import declare_settings, warn_of_undeclared_overrides
from vislam_ros.nodes.settings import PredictionNodeSettings
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.tf import TransformSender

Array = NDArray[np.float64]
Sample: TypeAlias = tuple[int, Array, Array | None]
"""Of an IMU: stamp (ns), angular velocity (3,), and specific force (3,) if it was measured."""

_PAIRED = (Stream.TWIST, Stream.IMU)
# So much of a gyroscope's data without a twist, or anybody who publishes twists, and there are
# none [ns].
_PATIENCE = NANOSECONDS


class ImuPredictionNode(Node):
    """Owns ``odom_frame -> base_frame``; it never hears of corrections."""

    def __init__(self, **options: Any):
        super().__init__("imu_prediction_node", **options)
        self._settings = declare_settings(self, PredictionNodeSettings)
        prediction_settings = declare_settings(self, PredictionSettings)
        self.core = DeadReckoning(prediction_settings)
        self._frames = Frames(odom=self._settings.odom_frame, base=self._settings.base_frame)
        time_jumps = dict.fromkeys(_PAIRED, prediction_settings.time_jump)
        self._passes = Passes(time_jumps, self._refuse)
        self._pairs = StampPairs(self._refuse_unpaired)
        self._latest: Prediction | None = None
        self._published = 0
        self._source = prediction_settings.motion_source
        self._held: list[Sample] = []  # of the IMU, until the source is chosen
        self.monitor = Monitor(self, self._describe, self._warning)
        self._tf = TransformSender(self, self.monitor) if self._settings.publish_tf else None
        self._odometry = self.monitor.advertise(PREDICTION)
        if self._source != "gyro":
            self.monitor.subscribe(TWIST, self.on_twist)
        if self._source != "twist" or self._turns_are_imus:
            self.monitor.subscribe(IMU, self.on_imu)
        warn_of_undeclared_overrides(self)

    def on_twist(self, message: TwistWithCovarianceStamped) -> None:
        """Predict, at once or when the angular velocity of this stamp is here."""
        stamp, twist = decoding.twist(message, self._frames)
        if self._source == "auto":
            self._choose("twist")
        if self._turns_are_imus:
            self._pair(Stream.TWIST, stamp, twist)
        else:
            self._add_twist(stamp, twist)

    def on_imu(self, message: Imu) -> None:
        """Predict by the gyroscope, or if the twist of this stamp is here."""
        stamp, omega = decoding.angular_velocity(message, self._frames)
        sample = stamp, omega, decoding.linear_acceleration(message)
        if self._source == "auto":
            self._hold(sample)
        else:
            self._take(*sample)

    def _take(self, stamp: int, omega: Array, acceleration: Array | None) -> None:
        """Take a sample of the IMU, now that the source is chosen."""
        if self._source == "gyro":
            self._predict(self.core.add_angular_velocity(stamp, omega, acceleration))
        are_twists = self._source == "twist" or self._passes.has_begun(Stream.TWIST)
        if self._turns_are_imus and are_twists:
            self._pair(Stream.IMU, stamp, omega)

    def _hold(self, sample: Sample) -> None:
        """Keep a sample of the IMU until it is clear that there are no twists."""
        self._held.append(sample)
        if abs(sample[0] - self._held[0][0]) >= _PATIENCE:
            self._choose("twist" if self.count_publishers(TWIST.name) else "gyro")

    def _choose(self, source: str) -> None:
        """Settle where the motion comes from."""
        self._source = source
        held, self._held = self._held, []
        if source == "gyro":
            self.get_logger().info(f"no {TWIST.name}: the gyroscope alone measures the motion")
        for sample in held:
            self._take(*sample)

    @property
    def _turns_are_imus(self) -> bool:
        """Whether twists take the angular velocity of the IMU's message of their stamp."""
        return self._settings.angular_velocity_source == "imu"

    def _pair(self, stream: Stream, stamp: int, values: Array) -> None:
        for _, believed, its_values in self._passes.enter(stream, stamp, values):
            if pair := self._pairs.add(_PAIRED.index(stream), believed, its_values):
                twist, omega = pair
                self._add_twist(believed, np.concatenate([twist[:3], omega]))

    def _add_twist(self, stamp: int, twist: Array) -> None:
        """Predict by a twist; the first that is believed ends the time of the gyroscope alone."""
        self._predict(self.core.add_twist(stamp, twist))
        if self._source == "gyro" and self.core.has_twists:
            self._source = "twist"
            self.get_logger().info(
                f"{TWIST.name} has begun: twists measure the motion from now on"
            )

    def _refuse_unpaired(self, stream: int, stamp: int) -> None:
        self._refuse(_PAIRED[stream], Refusal.UNPAIRED, stamp)

    def _refuse(self, stream: Stream, refusal: Refusal, stamp: int) -> None:
        self.monitor.refuse(refusal, stream=stream, stamp=stamp)

    def _predict(self, predictions: list[Prediction]) -> None:
        self.monitor.absorb("core", self.core.refused)
        for prediction in predictions:
            self._publish(prediction)

    def _publish(self, prediction: Prediction) -> None:
        self._latest = prediction
        self._published += 1
        odometry = conversions.odometry(
            prediction.stamp,
            self._settings.odom_frame,
            self._settings.base_frame,
            prediction.position,
            prediction.quaternion,
            prediction.covariance,
            prediction.twist,
            prediction.twist_covariance,
        )
        self.monitor.publish(self._odometry, odometry)
        if self._tf is not None and self._tf.is_heard:
            self._tf.send(conversions.transform_of_odometry(odometry))

    def _awaited(self) -> str:
        """What has to come before the first prediction."""
        if self._source == "gyro":
            return IMU.name
        if self._source == "auto":
            return f"{TWIST.name} or {IMU.name}"
        if self._turns_are_imus and self._passes.has_begun(Stream.TWIST):
            return f"{IMU.name} with the stamps of {TWIST.name}"
        return TWIST.name

    def _warning(self) -> str | None:
        """What is wrong at present."""
        if not self._pairs.is_left(_PAIRED.index(Stream.TWIST)):
            return None
        return f"angular_velocity_source: imu, and no {IMU.name} has the stamp of a twist"

    def _describe(self) -> tuple[str, dict[str, object]]:
        latest = self._latest
        over = self._passes.refused_if_over()
        over.merge(self.core.refused_if_over)
        if latest is None:
            return f"waiting for {self._awaited()}", values_if_over(over)
        position_std = float(np.sqrt(np.trace(latest.covariance[:3, :3])))
        return "running", {
            **values_if_over(over),
            "stamp age [s]": stamp_age(self, latest.stamp),
            "predictions": self._published,
            "motion source": self._source,
            "resets": self.core.resets,
            "position std [m]": position_std,
        }


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    return run(ImuPredictionNode, args)


if __name__ == "__main__":
    sys.exit(main())
