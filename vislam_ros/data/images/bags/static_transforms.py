# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a frame is in another, along a chain of transforms that do not change."""

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.tracking.refusals import RefusedMessage, check_pose

Array = NDArray[np.float64]


class StaticTransforms:
    """Transforms as ``/tf_static`` tells them, the newest of each pair of frames."""

    def __init__(self) -> None:
        self._neighbours: dict[str, dict[str, Array]] = {}

    def add(self, transforms: Iterable[Any]) -> None:
        """Take TransformStamped messages; a bad one among them costs no other.

        Raises
        ------
        RefusedMessage
            Where one holds no pose.
        """
        refused: RefusedMessage | None = None
        for stamped in transforms:
            t, q = stamped.transform.translation, stamped.transform.rotation
            position, quaternion = np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w])
            try:
                check_pose(position, quaternion)
            except RefusedMessage as error:
                refused = refused or error
                continue
            T = se3.pose_matrix(position, quaternion)
            parent, child = frame_name(stamped.header.frame_id), frame_name(stamped.child_frame_id)
            self._neighbours.setdefault(parent, {})[child] = T
            self._neighbours.setdefault(child, {})[parent] = se3.inverse(T)
        if refused is not None:
            raise refused

    def pose(self, base: str, frame: str) -> Array | None:
        """Pose (4, 4) of a frame in a base, None where no chain joins them."""
        base, frame = frame_name(base), frame_name(frame)
        known, waiting = {base: np.eye(4)}, deque([base])
        while waiting:
            name = waiting.popleft()
            if name == frame:
                return known[name]
            for other, T in self._neighbours.get(name, {}).items():
                if other not in known:
                    known[other] = known[name] @ T
                    waiting.append(other)
        return None


def frame_name(name: str) -> str:
    """Name of a frame as TF compares it."""
    return str(name).lstrip("/")
