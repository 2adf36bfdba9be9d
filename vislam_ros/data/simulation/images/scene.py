# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene: surfaces that stand, and objects that move."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.simulation.images.surfaces import SurfaceStack

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MovingObject:
    """A rigid object on its way.

    Attributes
    ----------
    surfaces : SurfaceStack
        In its own frame.
    pose : callable
        ``T_world_object`` (4, 4) at a time, seconds from the begin.
    """

    surfaces: SurfaceStack
    pose: Callable[[float], Array]


@dataclass(frozen=True)
class Scene:
    """What the cameras look at.

    Attributes
    ----------
    still : SurfaceStack
        In the world.
    moving : tuple of MovingObject
    empty : int
        Grey where there is nothing.
    """

    still: SurfaceStack
    moving: tuple[MovingObject, ...]
    empty: int

    def at(self, seconds: float) -> SurfaceStack:
        """All surfaces in the world at a time, seconds from the begin."""
        surfaces = self.still
        for each in self.moving:
            surfaces = surfaces.followed_by(each.surfaces.moved(each.pose(seconds)))
        return surfaces
