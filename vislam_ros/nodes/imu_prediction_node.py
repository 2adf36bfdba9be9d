# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning as a node: ``imu/twist`` in, ``prediction/odometry`` out."""

import sys
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Imu

from vislam_ros.core.filters.dead_reckoning import DeadReckoning, Prediction
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.core.tracking.refusals import Refusal, Stream
from vislam_ros.core.tracking.stamp_pairs import StampPairs
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import IMU, PREDICTION, TWIST, Frames
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor, stamp_age
from vislam_ros.nodes.parameters import declare_settings, warn_of_undeclared_overrides
from vislam_ros.nodes.settings import PredictionNodeSettings
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.tf import TransformSender

Array = NDArray[np.float64]


class ImuPredictionNode(Node):
    """Owns ``odom_frame -> base_frame``; it never hears of corrections."""

    def __init__(self, **options: Any):
        super().__init__("imu_prediction_node", **options)
        self._settings = declare_settings(self, PredictionNodeSettings)
        self.core = DeadReckoning(declare_settings(self, PredictionSettings))
        self._frames = Frames(odom=self._settings.odom_frame, base=self._settings.base_frame)
        self._pairs = StampPairs(self._refuse_unpaired)
        self._latest: Prediction | None = None
        self._published = 0
        self.monitor = Monitor(self, self._describe)
        self._tf = TransformSender(self, self.monitor) if self._settings.publish_tf else None
        self._odometry = self.monitor.advertise(PREDICTION)
        self.monitor.subscribe(TWIST, self.on_twist)
        if self._settings.angular_velocity_source == "imu":
            self.monitor.subscribe(IMU, self.on_imu)
        warn_of_undeclared_overrides(self)

    def on_twist(self, message: TwistWithCovarianceStamped) -> None:
        """Predict, at once or when the angular velocity of this stamp is here."""
        stamp, twist = decoding.twist(message, self._frames)
        if self._settings.angular_velocity_source == "imu":
            self._predict_pair(stamp, self._pairs.add(0, stamp, twist))
        else:
            self._predict(stamp, twist)

    def on_imu(self, message: Imu) -> None:
        """Predict if the twist of this stamp is here."""
        stamp, omega = decoding.angular_velocity(message, self._frames)
        self._predict_pair(stamp, self._pairs.add(1, stamp, omega))

    def _predict_pair(self, stamp: int, pair: tuple[Array, Array] | None) -> None:
        if pair is not None:
            twist, omega = pair
            self._predict(stamp, np.concatenate([twist[:3], omega]))

    def _refuse_unpaired(self, stream: int, stamp: int) -> None:
        streams = (Stream.TWIST, Stream.IMU)
        self.monitor.refuse(Refusal.UNPAIRED, stream=streams[stream], stamp=stamp)

    def _predict(self, stamp: int, twist: Array) -> None:
        prediction = self.core.add_twist(stamp, twist)
        self.monitor.absorb("core", self.core.refused)
        if prediction is None:
            return
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
        if self._tf is not None:
            self._tf.send(conversions.transform_of_odometry(odometry))

    def _describe(self) -> tuple[str, dict[str, object]]:
        latest = self._latest
        if latest is None:
            return f"waiting for {TWIST.name}", {}
        position_std = float(np.sqrt(np.trace(latest.covariance[:3, :3])))
        return "running", {
            "stamp age [s]": stamp_age(self, latest.stamp),
            "predictions": self._published,
            "resets": self.core.resets,
            "position std [m]": position_std,
        }


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    return run(ImuPredictionNode, args)


if __name__ == "__main__":
    sys.exit(main())
