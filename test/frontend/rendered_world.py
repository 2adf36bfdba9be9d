# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A small world of textured rectangles, seen by a stereo camera: images with exact truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

#: Rays to a side of a pixel: a pixel sees an area, not a point.
_RAYS = 2


@dataclass(frozen=True)
class Shot:
    """A stereo pair (H, W), the left image's depths (H, W) in metres, and the camera's pose."""

    left: Grey
    right: Grey
    depth: NDArray[np.float32]
    T_world_camera: Array


@dataclass(frozen=True)
class Rectangle:
    """A textured rectangle: its middle, its two half sides (metres) and its texture."""

    middle: Array
    right: Array
    down: Array
    texture: NDArray[np.float32]


def texture(rng: np.random.Generator, size: int = 1024) -> NDArray[np.float32]:
    """Grey values (size, size) with detail of every size: patches, spots and grain."""
    result = np.zeros((size, size), np.float32)
    for cells, contrast in ((8, 20), (32, 25), (128, 35), (256, 20)):
        grain = rng.uniform(-1, 1, (cells, cells)).astype(np.float32)
        how = cv2.INTER_NEAREST if cells == 128 else cv2.INTER_CUBIC
        result += contrast * cv2.resize(grain, (size, size), interpolation=how)
    return np.clip(result + 120, 5, 250)


def room(rng: np.random.Generator, half: tuple[float, float, float]) -> list[Rectangle]:
    """The six walls of a room of these half sides about the origin, metres."""
    walls = []
    for axis in range(3):
        a, b = (np.eye(3)[k] * half[k] for k in range(3) if k != axis)
        walls += [
            Rectangle(side * half[axis] * np.eye(3)[axis], a, b, texture(rng)) for side in (-1, 1)
        ]
    return walls


def camera_of(width: int, height: int, baseline: float) -> StereoCamera:
    """A camera that sees 90 degrees, whose axes are the body's."""
    focal = width / 2
    K = np.array([[focal, 0, width / 2 - 0.3], [0, focal, height / 2 + 0.4], [0, 0, 1]])
    return StereoCamera.from_matrices(K, baseline, np.eye(4))


def view(
    world: Sequence[Rectangle], camera: StereoCamera, size: tuple[int, int], T_world_camera: Array
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey values (H, W) of the mean over each pixel, and depths (H, W) at the pixels' middles."""
    width, height = size
    fine = (np.arange(_RAYS) - (_RAYS - 1) / 2) / _RAYS
    u = (np.arange(width)[:, None] + fine).ravel()
    v = (np.arange(height)[:, None] + fine).ravel()
    grey = _cast(world, camera, T_world_camera, u, v)[0]
    middles = np.arange(width, dtype=float), np.arange(height, dtype=float)
    depth = _cast(world, camera, T_world_camera, *middles)[1]
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.float32), depth


def stereo_view(
    world: Sequence[Rectangle],
    camera: StereoCamera,
    size: tuple[int, int],
    T_world_camera: Array,
    rng: np.random.Generator,
    noise: float = 2.0,
) -> Shot:
    """Shot with noise (grey values)."""
    T_left_right = se3.pose_matrix([camera.baseline, 0, 0], [0, 0, 0, 1])
    left, depth = view(world, camera, size, T_world_camera)
    right, _ = view(world, camera, size, T_world_camera @ T_left_right)
    images = [
        np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    return Shot(images[0], images[1], depth, T_world_camera)


def _cast(
    world: Sequence[Rectangle], camera: StereoCamera, T_world_camera: Array, u: Array, v: Array
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Grey values and depths along the rays through all u and v."""
    x, y = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    depth = np.full(x.shape, np.inf, np.float32)
    grey = np.zeros(x.shape, np.float32)
    for plane in world:
        normal = np.cross(plane.right, plane.down)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (plane.middle - origin) @ normal / (rays @ normal)
            hit = origin + distance[..., None] * rays - plane.middle
            a = hit @ plane.right / (plane.right @ plane.right)
            b = hit @ plane.down / (plane.down @ plane.down)
            seen = (distance > 0) & (distance < depth) & (np.abs(a) <= 1) & (np.abs(b) <= 1)
        side = (len(plane.texture) - 1) / 2
        place = [np.where(seen, (c + 1) * side, 0).astype(np.float32) for c in (a, b)]
        colour = cv2.remap(plane.texture, place[0], place[1], cv2.INTER_LINEAR)
        grey[seen], depth[seen] = colour[seen], distance[seen]
    return grey, depth
