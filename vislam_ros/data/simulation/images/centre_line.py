# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The line on the ground that a drive follows, and goes on with where it ends."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CentreLine:
    """Ground under a drive, by the way along it, metres from its begin.

    Points at least ``spacing`` apart, straight on before the begin and after the end.

    Parameters
    ----------
    T_world_body : ndarray, (n, 4, 4)
    body_height : float
        Of the body over the ground, metres.
    before, after : float
        How far the street reaches behind and ahead of the drive, metres.
    spacing : float
        Metres.
    """

    def __init__(
        self,
        T_world_body: Array,
        *,
        body_height: float,
        before: float,
        after: float,
        spacing: float = 6.0,
    ) -> None:
        positions = T_world_body[:, :3, 3]
        kept = [0]
        for k in range(1, len(positions)):
            if np.linalg.norm(positions[k, :2] - positions[kept[-1], :2]) >= spacing:
                kept.append(k)
        points = positions[kept]
        first, last = (_level(T_world_body[k, :3, 0]) for k in (0, kept[-1]))
        steps = spacing * np.arange(1, np.ceil(max(before, after) / spacing) + 1)[:, None]
        behind = points[0] - first * steps[: round(before / spacing)][::-1]
        ahead = points[-1] + last * steps[: round(after / spacing)]
        self.points: Array = np.concatenate([behind, points, ahead]) - [0, 0, body_height]
        lengths = np.linalg.norm(np.diff(self.points[:, :2], axis=0), axis=1)
        self.ways: Array = np.concatenate([[0.0], np.cumsum(lengths)])
        self.ways -= self.ways[len(behind)]
        tangent = np.gradient(self.points[:, :2], self.ways, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        #: To the left, level, (n, 3).
        self.left: Array = np.column_stack([-tangent[:, 1], tangent[:, 0], np.zeros(len(tangent))])

    def place(self, way: float | Array, left: float | Array) -> Array:
        """Points (..., 3) on the ground so far along the line and to the left of it."""
        along = np.asarray(way, dtype=float)
        point = np.stack([np.interp(along, self.ways, x) for x in self.points.T], axis=-1)
        return point + self._left(along) * np.asarray(left, dtype=float)[..., None]

    def pose(self, way: float, left: float, *, back: bool = False) -> Array:
        """Pose (4, 4) there that looks along the line, or back; it stands upright."""
        y = self._left(np.asarray(way)) * (-1 if back else 1)
        T = np.eye(4)
        T[:3, 0] = [y[1], -y[0], 0]
        T[:3, 1], T[:3, 3] = y, self.place(way, left)
        return T

    def distance(self, points: Array) -> float:
        """Least level distance of points (n, 3) from the line, metres."""
        apart = points[:, None, :2] - self.points[None, :, :2]
        return float(np.linalg.norm(apart, axis=-1).min())

    def _left(self, way: Array) -> Array:
        left = np.stack([np.interp(way, self.ways, x) for x in self.left.T], axis=-1)
        return left / np.linalg.norm(left, axis=-1, keepdims=True)


def _level(direction: Array) -> Array:
    level = direction * [1.0, 1.0, 0.0]
    return level / np.linalg.norm(level)
