# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a viewer needs of a recorded run beside the messages themselves: transforms and the path.

They are made of the recorded poses, so ``results.mcap`` can be looked at whether or not anybody
published ``/tf``. The tree is that of REP 105: the prediction owns ``odom -> base``, the estimate
``map -> odom = T_map_base T_odom_base^-1``, both at the stamp of a step.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.tracking.refusals import RefusedMessage, check_pose
from vislam_ros.data.bags.encoding import jazzy_types
from vislam_ros.data.bags.layout import PATH, STATIC_TRANSFORMS, TRANSFORMS, Topic
from vislam_ros.data.trajectory import NANOSECONDS

# Bounds of what is kept, whatever comes: poses that wait for their counterpart, poses of a path.
_MOST_WAITING = 10_000
_MOST_OF_A_PATH = 8192
# A path is written anew when it has grown by this factor, so that all of them together take a few
# times what the last one takes.
_GROWTH = 1.25
_FIRST_PATH = 8

_STORE = jazzy_types()
_NEW: dict[str, Any] = {name.rsplit("/")[-1]: made for name, made in _STORE.types.items()}


@dataclass(frozen=True)
class Made:
    """A message that was made: its topic, CDR bytes and stamp (ns)."""

    topic: Topic
    data: bytes
    stamp: int


@dataclass(frozen=True)
class _Placed:
    stamp: int
    T: NDArray[np.float64]
    parent: str
    child: str


class Scene:
    """Makes transforms and paths of the poses of one pass."""

    def __init__(self) -> None:
        self._predictions: deque[_Placed] = deque(maxlen=_MOST_WAITING)
        self._steps: deque[_Placed] = deque(maxlen=_MOST_WAITING)
        self._path: list[Any] = []
        self._path_frame = ""
        self._every, self._count, self._next_path = 1, 0, float(_FIRST_PATH)
        self._last_stamp, self._last_path = 0, 0

    def add_prediction(
        self, stamp: int, position: ArrayLike, quaternion: ArrayLike, parent: str, child: str
    ) -> Iterator[Made]:
        """Add a predicted pose at a stamp (ns) between two frames; yield what it makes.

        What is no pose a recorder writes down, too, but no viewer can show it.
        """
        if not _can_be_shown(position, quaternion):
            return
        yield transform_message(TRANSFORMS, stamp, position, quaternion, parent, child)
        self._predictions.append(
            _Placed(stamp, se3.pose_matrix(position, quaternion), parent, child)
        )
        yield from self._matched()

    def add_step(
        self, stamp: int, position: ArrayLike, quaternion: ArrayLike, parent: str, child: str
    ) -> Iterator[Made]:
        """Add a pose of the estimate, as :meth:`add_prediction`."""
        if not _can_be_shown(position, quaternion):
            return
        self._steps.append(_Placed(stamp, se3.pose_matrix(position, quaternion), parent, child))
        yield from self._matched()
        self._last_stamp, self._path_frame = stamp, parent
        if self._count % self._every == 0:
            self._path.append(
                _NEW["PoseStamped"](
                    header=_header(stamp, parent),
                    pose=_NEW["Pose"](position=_point(position), orientation=_turn(quaternion)),
                )
            )
        self._count += 1
        if len(self._path) > _MOST_OF_A_PATH:
            self._path, self._every = self._path[::2], 2 * self._every
        if self._count >= self._next_path:
            self._next_path *= _GROWTH
            yield self._whole_path()

    def finish(self) -> Iterator[Made]:
        """Yield the path of all that was added, unless it stands there already."""
        if self._count and self._last_path != self._count:
            yield self._whole_path()

    def _whole_path(self) -> Made:
        self._last_path = self._count
        message = _NEW["Path"](
            header=_header(self._last_stamp, self._path_frame), poses=self._path
        )
        data = bytes(_STORE.serialize_cdr(message, PATH.msgtype))
        return Made(PATH, data, self._last_stamp)

    def _matched(self) -> Iterator[Made]:
        """Yield the transform of each step whose prediction is here."""
        predictions, steps = self._predictions, self._steps
        while steps and predictions and predictions[-1].stamp >= steps[0].stamp:
            step = steps.popleft()
            while len(predictions) > 1 and predictions[1].stamp <= step.stamp:
                predictions.popleft()
            before = predictions[0]
            if before.stamp > step.stamp:
                continue  # nobody knows where the prediction was
            T_odom_base = before.T
            if before.stamp < step.stamp:
                after = predictions[1]
                share = (step.stamp - before.stamp) / (after.stamp - before.stamp)
                T_odom_base = se3.interpolate(before.T, after.T, share)
            T = step.T @ se3.inverse(T_odom_base)
            quaternion = se3.quaternion_from_rotation(T[:3, :3])
            yield transform_message(
                TRANSFORMS, step.stamp, T[:3, 3], quaternion, step.parent, before.parent
            )


def _can_be_shown(position: ArrayLike, quaternion: ArrayLike) -> bool:
    try:
        check_pose(position, quaternion)
    except RefusedMessage:
        return False
    return True


def static_transform(
    stamp: int, position: ArrayLike, quaternion: ArrayLike, parent: str, child: str
) -> Made:
    """Message on ``tf_static`` with a stamp (ns), as extrinsics have it."""
    return transform_message(STATIC_TRANSFORMS, stamp, position, quaternion, parent, child)


def transform_message(
    topic: Topic, stamp: int, position: ArrayLike, quaternion: ArrayLike, parent: str, child: str
) -> Made:
    """Message of one transform: the pose of ``child`` in ``parent`` at a stamp (ns)."""
    x, y, z = (float(value) for value in np.asarray(position))
    transform = _NEW["TransformStamped"](
        header=_header(stamp, parent),
        child_frame_id=child,
        transform=_NEW["Transform"](
            translation=_NEW["Vector3"](x=x, y=y, z=z), rotation=_turn(quaternion)
        ),
    )
    message = _NEW["TFMessage"](transforms=[transform])
    return Made(topic, bytes(_STORE.serialize_cdr(message, topic.msgtype)), stamp)


def _header(stamp: int, frame: str) -> Any:
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return _NEW["Header"](stamp=_NEW["Time"](sec=sec, nanosec=nanosec), frame_id=frame)


def _point(position: ArrayLike) -> Any:
    x, y, z = (float(value) for value in np.asarray(position))
    return _NEW["Point"](x=x, y=y, z=z)


def _turn(quaternion: ArrayLike) -> Any:
    x, y, z, w = (float(value) for value in np.asarray(quaternion))
    return _NEW["Quaternion"](x=x, y=y, z=z, w=w)
