# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The front end as a node: stereo images in, ``stereo/features`` and rectified cameras out."""

import functools
import sys
import time
from dataclasses import replace
from typing import Any

import cv2
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rosbags.interfaces import QosHistory
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, Stream
from vislam_ros.data.bags import decoding, layout
from vislam_ros.data.bags.calibration import CALIBRATION_TOPICS
from vislam_ros.data.bags.image_messages import image
from vislam_ros.data.bags.layout import Frames, Topic
from vislam_ros.data.images.image_file import decoded
from vislam_ros.errors import VislamError
from vislam_ros.frontend.pair_tracker import PairTracker, Raw
from vislam_ros.frontend.picture import Trails, drawn_tracks
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import Tracked
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor, values_if_over
from vislam_ros.nodes.parameters import declare_settings, warn_of_undeclared_overrides
from vislam_ros.nodes.settings import TrackerNodeSettings
from vislam_ros.nodes.spin import run
from vislam_ros.nodes.topics import message_class
from vislam_ros.nodes.tracker.cameras import HEARD_TRANSFORMS, RawCameras, sized
from vislam_ros.nodes.tracker.report import TrackerReport
from vislam_ros.nodes.tracker.stereo_stream import ReadyPair, StereoStream

_SIDES = (Stream.LEFT_IMAGE, Stream.RIGHT_IMAGE)


class StereoTrackerNode(Node):
    """One ``stereo/features`` for each pair of images, but for those that repeat the last."""

    def __init__(self, **options: Any):
        super().__init__("stereo_tracker_node", **options)
        self._settings = declare_settings(self, TrackerNodeSettings)
        self._tracker_settings = declare_settings(self, TrackerSettings, self._change_tracker)
        self._frames = Frames(base=self._settings.base_frame, camera=self._settings.camera_frame)
        self._stream = StereoStream(self._settings, self._refuse)
        self._cameras = RawCameras(
            self._frames,
            rectified=self._are_rectified(),
            extrinsics_come=lambda: self.count_publishers(layout.EXTRINSICS.name) > 0,
        )
        self._tracker: PairTracker | None = None
        self._trails = Trails()
        self._report = TrackerReport()
        self.monitor = Monitor(self, self._describe)
        self._features = self.monitor.advertise(layout.FEATURES)
        self._calibration = [
            self.monitor.advertise(topic) for topic in layout.RECTIFIED_CALIBRATION
        ]
        self._pictures = self.monitor.advertise(layout.TRACK_IMAGE)
        for topic in CALIBRATION_TOPICS:
            self.monitor.subscribe(topic, functools.partial(self.on_calibration, topic))
        if message_class(HEARD_TRANSFORMS.msgtype) is not None:
            self.monitor.subscribe(HEARD_TRANSFORMS, self.on_static_transforms)
        for side, topic in zip(_SIDES, self._image_topics(), strict=True):
            self.monitor.subscribe(topic, functools.partial(self.on_image, side))
        if self._settings.gyroscope != "never":
            self.monitor.subscribe(layout.IMU, self.on_imu)
        warn_of_undeclared_overrides(self)

    def _image_topics(self) -> list[Topic]:
        topics = layout.IMAGES[2:] if self._settings.compressed else layout.IMAGES[:2]
        size = self._settings.queue_size
        qos = layout.STREAM_QOS
        if size:
            qos = qos._replace(history=QosHistory.KEEP_LAST, depth=size)
        return [replace(topic, qos=qos) for topic in topics]

    def _are_rectified(self) -> bool:
        if self._settings.images != "auto":
            return self._settings.images == "rectified"
        name = layout.LEFT_COMPRESSED if self._settings.compressed else layout.LEFT_IMAGE
        return "rect" in self.resolve_topic_name(name.name)

    def on_calibration(self, topic: Topic, message: CameraInfo | TransformStamped) -> None:
        """Take a camera info or the extrinsics of the raw left camera."""
        if self._cameras.add(topic, message):
            self._recalibrate()

    def on_static_transforms(self, message: Any) -> None:
        """Take transforms that may tell where the left camera is on the body."""
        try:
            self._cameras.transforms.add(message.transforms)
        finally:  # the good ones beside a bad one count
            if self._cameras.settle():
                self._recalibrate()

    def _recalibrate(self) -> None:
        if self._tracker is not None:
            self.get_logger().warning("the calibration changed: it holds from the next pass on")
        self._stream.is_open = True
        self._track(self._stream.advance())

    def on_image(self, side: Stream, message: Image | CompressedImage) -> None:
        """Take an image of one side."""
        came_at = time.monotonic()
        stamp = decoding.stamp_of(message.header)
        self._track(self._stream.add_image(side, stamp, _pixels(message), came_at))

    def on_imu(self, message: Imu) -> None:
        """Take an angular velocity."""
        stamp, omega = decoding.angular_velocity(message, self._frames)
        self._track(self._stream.add_angular_velocity(stamp, omega))

    def _track(self, pairs: list[ReadyPair]) -> None:
        for pair in pairs:
            try:
                tracked = self._tracked(pair)
            except RefusedMessage as error:
                self.monitor.refuse(error.refusal, str(error), Stream.IMAGES, pair.stamp)
                continue
            if not tracked.repeated:
                frame = self._frames.camera
                self.monitor.publish(
                    self._features,
                    conversions.features_to_message(
                        pair.stamp, frame, tracked.ids, tracked.pixels, tracked.noise
                    ),
                )
            self._report.add(tracked, 1e3 * (time.monotonic() - pair.came_at))
            self._draw(pair.stamp, tracked)

    def _tracked(self, pair: ReadyPair) -> Tracked:
        """Track a pair; raises a RefusedMessage where its images or the cameras will not do."""
        try:
            if self._tracker is None or pair.begins_pass:
                self._begin(pair)
            assert self._tracker is not None
            return self._tracker.track(pair.left, pair.right, pair.turn)
        except RefusedMessage:
            raise
        except VislamError as error:
            raise RefusedMessage(Refusal.WRONG_SIZE, str(error)) from error

    def _begin(self, pair: ReadyPair) -> None:
        """Track with the newest cameras, and tell what they are once rectified."""
        self._tracker = None
        assert self._cameras.rig is not None
        rig = sized(self._cameras.rig, _size(pair.left[0]), _size(pair.right[0]))
        try:
            tracker = PairTracker(rig, self._tracker_settings)
        except VislamError as error:
            raise RefusedMessage(Refusal.NOT_A_PAIR, str(error)) from error
        self._tracker, self._trails = tracker, Trails()
        messages = conversions.calibration(
            pair.stamp, self._frames, tracker.camera, tracker.image_size
        )
        for publisher, message in zip(self._calibration, messages, strict=True):
            self.monitor.publish(publisher, message)

    def _draw(self, stamp: int, tracked: Tracked) -> None:
        """Publish the picture of the tracks, if anybody looks."""
        if not self._pictures.get_subscription_count() or self._tracker is None:
            return
        self._trails.add(tracked)
        left = self._tracker.left
        if left is not None:
            picture = drawn_tracks(left, tracked, self._trails)
            message = conversions.image_to_message(stamp, self._frames.camera, picture, "bgr8")
            self.monitor.publish(self._pictures, message)

    def _change_tracker(self, settings: TrackerSettings) -> None:
        self._tracker_settings = settings
        if self._tracker is not None:
            self._tracker.change_settings(settings)

    def _refuse(self, stream: Stream, refusal: Refusal, stamp: int) -> None:
        self.monitor.refuse(refusal, stream=stream, stamp=stamp)

    def _describe(self) -> tuple[str, dict[str, object]]:
        if missing := self._cameras.missing():
            activity = f"waiting for calibration: {', '.join(missing)}"
        elif self._tracker is None:
            activity = "waiting for images"
        else:
            activity = "running"
        return activity, {
            **self._report.values(),
            **values_if_over(self._stream.refused_if_over),
            "pairs waiting": self._stream.waiting,
            "pairs without gyroscope": self._stream.without_turn,
        }


def _pixels(message: Image | CompressedImage) -> Raw:
    """Pixels and encoding of a message; raises a RefusedMessage where it holds none."""
    if isinstance(message, Image):
        return image(message)
    try:
        return decoded(bytes(message.data), "compressed image")
    except VislamError as error:
        raise RefusedMessage(Refusal.UNDECODABLE, str(error)) from error


def _size(pixels: NDArray[Any]) -> tuple[int, int]:
    """Width and height of an image."""
    height, width = pixels.shape[:2]
    return width, height


def main(args: list[str] | None = None) -> int:
    """Run the node until a signal."""
    # As offline; and the other nodes need the other cores.
    cv2.setNumThreads(1)
    return run(StereoTrackerNode, args)


if __name__ == "__main__":
    sys.exit(main())
