# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Flat textured surfaces: what a scene is made of."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.data.simulation.images.texture import Texture

Array = NDArray[np.float64]


class Layer(IntEnum):
    """What may hide what.

    Pieces of ``FLOOR`` lie over each other in the order in which they are given. A ``SOLID`` hides
    what is farther. A ``BACKDROP`` is infinitely far.
    """

    FLOOR = 0
    SOLID = 1
    BACKDROP = 2


@dataclass(frozen=True)
class Surface:
    """A convex polygon of three or four corners with its texture.

    Attributes
    ----------
    texture : Texture
    world_from_texels : ndarray, (3, 3)
        Takes (u, v, 1), texels from the texture's top left corner, to metres in the world. It is
        seen from the side from which u points right and v down.
    corners : ndarray, (4, 3)
        World, metres; the last twice where there are three.
    shade : float
        Light that it gets, 1 where the texture is shown as it is.
    layer : Layer
    """

    texture: Texture
    world_from_texels: Array
    corners: Array
    shade: float = 1.0
    layer: Layer = Layer.SOLID


def rectangle(
    texture: Texture,
    top_left: ArrayLike,
    right: ArrayLike,
    down: ArrayLike,
    *,
    start: tuple[float, float] = (0.0, 0.0),
    shade: float = 1.0,
    layer: Layer = Layer.SOLID,
) -> Surface:
    """Rectangle with a texture in its own size.

    Parameters
    ----------
    texture : Texture
    top_left, right, down : array_like, (3,)
        Corner and sides as they are seen, world, metres.
    start : tuple of float, (2,)
        Texels of the texture at the top left corner.
    shade : float
    layer : Layer
    """
    origin, u, v = (np.asarray(x, dtype=float) for x in (top_left, right, down))
    per_texel = [side / np.linalg.norm(side) / texture.per_metre for side in (u, v)]
    first = origin - start[0] * per_texel[0] - start[1] * per_texel[1]
    corners = np.stack([origin, origin + u, origin + u + v, origin + v])
    return Surface(texture, np.column_stack([*per_texel, first]), corners, shade, layer)


def triangle(
    texture: Texture, corners: Array, texels: Array, *, layer: Layer = Layer.SOLID
) -> Surface:
    """Triangle whose corners (3, 3) show the given texels (3, 2)."""
    world_from_texels = corners.T @ np.linalg.inv(np.column_stack([texels, np.ones(3)]).T)
    return Surface(texture, world_from_texels, corners[[0, 1, 2, 2]], layer=layer)


def box(
    textures: Sequence[Texture],
    T_world_box: Array,
    size: ArrayLike,
    *,
    light: ArrayLike = (0.3, 0.5, 0.8),
) -> list[Surface]:
    """Faces of a box that stands on the origin of its frame: front, left, back, right, top.

    Parameters
    ----------
    textures : sequence of Texture
        Of front (x), left (y), back, right, and top; the last holds for those that are missing.
    T_world_box : ndarray, (4, 4)
    size : array_like, (3,)
        Along x, y and z, metres.
    light : array_like, (3,)
        Direction from which most of the light comes, world.
    """
    x, y, z = np.asarray(size, dtype=float) / [2, 2, 1]
    ex, ey, ez = np.eye(3)
    faces = [
        ([x, -y, z], 2 * y * ey, -z * ez, ex),
        ([x, y, z], -2 * x * ex, -z * ez, ey),
        ([-x, y, z], -2 * y * ey, -z * ez, -ex),
        ([-x, -y, z], 2 * x * ex, -z * ez, -ey),
        ([x, y, z], -2 * y * ey, -2 * x * ex, ez),
    ]
    R, p = T_world_box[:3, :3], T_world_box[:3, 3]
    direction = np.asarray(light, dtype=float) / np.linalg.norm(light)
    surfaces = []
    for i, (corner, right, down, normal) in enumerate(faces):
        shade = 0.75 + 0.25 * float(R @ normal @ direction)
        texture = textures[min(i, len(textures) - 1)]
        surfaces.append(rectangle(texture, R @ corner + p, R @ right, R @ down, shade=shade))
    return surfaces


@dataclass(frozen=True)
class SurfaceStack:
    """Many surfaces, as arrays.

    Attributes
    ----------
    textures : tuple of Texture, (n,)
    world_from_texels : ndarray, (n, 3, 3)
    corners : ndarray, (n, 4, 3)
    shades : ndarray, (n,)
    layers : ndarray of int, (n,)
    """

    textures: tuple[Texture, ...]
    world_from_texels: Array
    corners: Array
    shades: Array
    layers: NDArray[np.int64]

    @classmethod
    def of(cls, surfaces: Iterable[Surface]) -> "SurfaceStack":
        """Stack surfaces in the order of their layers, and in that in which they come."""
        ordered = sorted(surfaces, key=lambda surface: surface.layer)
        return cls(
            tuple(surface.texture for surface in ordered),
            np.array([surface.world_from_texels for surface in ordered]).reshape(-1, 3, 3),
            np.array([surface.corners for surface in ordered]).reshape(-1, 4, 3),
            np.array([surface.shade for surface in ordered]),
            np.array([surface.layer for surface in ordered], dtype=np.int64),
        )

    def moved(self, T: Array) -> "SurfaceStack":
        """Move all of them by a rigid motion."""
        moved = T[:3, :3] @ self.world_from_texels
        moved[:, :, 2] += T[:3, 3]
        corners = self.corners @ T[:3, :3].T + T[:3, 3]
        return replace(self, world_from_texels=moved, corners=corners)

    def followed_by(self, other: "SurfaceStack") -> "SurfaceStack":
        """Both stacks, the solids of the other last."""
        return SurfaceStack(
            self.textures + other.textures,
            np.concatenate([self.world_from_texels, other.world_from_texels]),
            np.concatenate([self.corners, other.corners]),
            np.concatenate([self.shades, other.shades]),
            np.concatenate([self.layers, other.layers]),
        )
