# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion that a bag of images holds, where the camera is on the body, and the truth."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.bag_messages import BagConnection, BagMessages
from vislam_ros.data.bags.gathered_pass import measured_forces
from vislam_ros.data.bags.layout import (
    EXTRINSICS,
    GROUND_TRUTH,
    IMU,
    STATIC_TRANSFORMS,
    TWIST,
    Frames,
    Topic,
)
from vislam_ros.data.images.bags.static_transforms import StaticTransforms
from vislam_ros.data.images.stereo_images import Motion
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]


class RecordedMotion:
    """Takes the messages of a bag that are no images, and tells what they say.

    Parameters
    ----------
    path : Path
        Of the bag, for errors.
    names : mapping of Topic to str
        What it calls its topics.
    frames : Frames
        Of extrinsics, and of the motion that they are for.
    """

    def __init__(self, path: Path, names: Mapping[Topic, str], frames: Frames):
        self._path = path
        self._topics = {name: topic for topic, name in names.items()}
        self._names = names
        self._frames = frames
        self._twists: dict[int, Array] = {}
        self._omegas: dict[int, Array] = {}
        self._accelerations: dict[int, Array | None] = {}
        self._poses: dict[int, tuple[Array, Array]] = {}
        self._transforms = StaticTransforms()
        self._extrinsics: Array | None = None
        self._body: str | None = None
        self._faults: dict[str, Counter[str]] = {}

    @property
    def notes(self) -> list[str]:
        """What was refused, by topic and reason."""
        return [
            f"Skipped {count} message{'s' if count > 1 else ''} of {name}: {reason}."
            for name, reasons in sorted(self._faults.items())
            for reason, count in sorted(reasons.items())
        ]

    def add(self, bag: BagMessages, connection: BagConnection, data: bytes) -> None:
        """Take a message; a bad one is counted."""
        topic = self._topics.get(connection.topic)
        if topic is None:
            return
        try:
            self._take(topic, bag.decode(connection, data))
        except RefusedMessage as error:
            self._faults.setdefault(connection.topic, Counter())[str(error)] += 1

    def motion(self) -> Motion | None:
        """Twists, or what the IMU measured; None where there is neither."""
        if not self._twists:
            return self.turns()
        stamps = sorted(self._twists)
        return Motion(
            np.array(stamps, dtype=np.int64), np.array([self._twists[stamp] for stamp in stamps])
        )

    def turns(self) -> Motion | None:
        """What the IMU measured; None where there is none."""
        if not self._omegas:
            return None
        stamps = sorted(self._omegas)
        return Motion.of_imu(
            np.array(stamps, dtype=np.int64),
            np.array([self._omegas[stamp] for stamp in stamps]),
            measured_forces([self._accelerations[stamp] for stamp in stamps]),
        )

    def ground_truth(self) -> Trajectory | None:
        """Poses of the topic of the truth."""
        if not self._poses:
            return None
        stamps = sorted(self._poses)
        return Trajectory(
            np.array(stamps, dtype=np.int64),
            np.array([self._poses[stamp][0] for stamp in stamps]),
            np.array([self._poses[stamp][1] for stamp in stamps]),
        )

    def extrinsics(self, camera_frame: str) -> Array:
        """Pose (4, 4) of the left camera in the body, by its own topic or by static transforms.

        Raises
        ------
        VislamError
            Where neither tells it.
        """
        if self._extrinsics is not None:
            return self._extrinsics
        body = self._body if self._body is not None else self._frames.base
        T = self._transforms.pose(body, camera_frame)
        if T is None:
            raise VislamError(
                f"{self._path}: nothing tells where frame {camera_frame!r} is in {body!r}: record "
                f"/{EXTRINSICS.name} or /{STATIC_TRANSFORMS.name}, or give a --motion that has "
                "the extrinsics"
            )
        return T

    def _take(self, topic: Topic, message: Any) -> None:
        if topic is EXTRINSICS:
            position, quaternion = decoding.extrinsics(message, self._frames)
            self._extrinsics = se3.pose_matrix(position, quaternion)
        elif topic is STATIC_TRANSFORMS:
            self._transforms.add(message.transforms)
        elif topic is GROUND_TRUTH:
            stamp, position, quaternion = decoding.true_pose(message)
            self._poses.setdefault(stamp, (position, quaternion))
        elif topic is TWIST:
            stamp, twist = decoding.twist(message, self._frames_of(message))
            self._twists.setdefault(stamp, twist)
        elif topic is IMU:
            stamp, omega = decoding.angular_velocity(message, self._frames_of(message))
            self._omegas.setdefault(stamp, omega)
            self._accelerations.setdefault(stamp, decoding.linear_acceleration(message))

    def _frames_of(self, message: Any) -> Frames:
        """Frames to hold the motion against: with extrinsics theirs, or those of its first one."""
        if EXTRINSICS in self._names:
            return self._frames
        if self._body is None:
            self._body = str(message.header.frame_id)
        return Frames(base=self._body)
