# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A room around a motion: walls, floor, ceiling, furniture along the walls, and what moves."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.simulation.images.scene import MovingObject, Scene
from vislam_ros.data.simulation.images.surfaces import Surface, SurfaceStack, box, rectangle
from vislam_ros.data.simulation.images.texture import (
    Field,
    Texture,
    bricks,
    fill,
    fractal,
    scribble,
    stripes,
)

Array = NDArray[np.float64]

_PER_METRE = 128
_FINE = 256  # texels a metre of what hangs on walls
_MARGIN = 2.2  # metres between the motion and a wall
_BELOW, _ABOVE = 1.3, 1.6  # metres between the motion and floor and ceiling


def room(T_world_body: Array, *, moving: int, rng: np.random.Generator) -> Scene:
    """Build a room that holds a motion.

    Parameters
    ----------
    T_world_body : ndarray, (n, 4, 4)
    moving : int
        Boxes that slide over the floor.
    rng : Generator
    """
    positions = T_world_body[:, :3, 3]
    low = positions.min(axis=0) - np.array([_MARGIN, _MARGIN, _BELOW])
    high = positions.max(axis=0) + np.array([_MARGIN, _MARGIN, _ABOVE])
    surfaces = _shell(low, high, rng)
    for k in range(4):
        surfaces += _along_wall(k, low, high, rng)
    objects = tuple(_sliding_box(k, low, high, rng) for k in range(moving))
    return Scene(SurfaceStack.of(surfaces), objects, 60)


def _wall_frame(k: int, low: Array, high: Array) -> tuple[Array, Array, Array, float]:
    """Lower left corner of wall k as it is seen, its way to the right, its normal, its length."""
    corners = [(high[0], high[1]), (high[0], low[1]), (low[0], low[1]), (low[0], high[1])]
    a, b = np.array(corners[k]), np.array(corners[(k + 1) % 4])
    length = float(np.linalg.norm(b - a))
    right = np.array([*(b - a) / length, 0.0])
    inward = np.array([right[1], -right[0], 0.0])
    return np.array([*a, low[2]]), right, inward, length


def _shell(low: Array, high: Array, rng: np.random.Generator) -> list[Surface]:
    x, y, z = high - low
    shape = (512, 1024)
    walls = [
        bricks(shape, (16, 32), rng, grey=115, spread=13) + 6 * fractal(shape, 128, rng),
        160 + 5 * fractal(shape, 256, rng) + 2 * fractal(shape, 4, rng),
        stripes(shape, 32, 16, 125, 165) + 4 * fractal(shape, 128, rng),
        140 + 9 * fractal(shape, 128, rng) + 4 * fractal(shape, 8, rng),
    ]
    surfaces = []
    for k, picture in enumerate(walls):
        fill(picture, 0, 0, shape[1], 10, 90)
        corner, right, _, length = _wall_frame(k, low, high)
        up = np.array([0.0, 0.0, z])
        texture = Texture(picture, _PER_METRE)
        surfaces.append(rectangle(texture, corner + up, right * length, -up, shade=1 - 0.07 * k))
    floor = Texture(_parquet(rng), _PER_METRE)
    ceiling = Texture(_panels(rng), _PER_METRE)
    surfaces.append(rectangle(floor, [high[0], high[1], low[2]], [0, -y, 0], [-x, 0, 0]))
    surfaces.append(rectangle(ceiling, [low[0], high[1], high[2]], [0, -y, 0], [x, 0, 0]))
    return surfaces


def _parquet(rng: np.random.Generator) -> Field:
    shape = (1024, 1024)
    grain = fractal((1024, 256), 64, rng)
    wide = np.asarray(cv2.resize(grain, (1024, 1024)), dtype=np.float32)
    return bricks(shape, (16, 128), rng, grey=105, spread=9) + 9 * wide


def _panels(rng: np.random.Generator) -> Field:
    canvas = 190 + 4 * fractal((512, 512), 64, rng)
    for k in range(0, 512, 128):
        fill(canvas, k, 0, 5, 512, 150)
        fill(canvas, 0, k, 512, 5, 150)
    fill(canvas, 150, 40, 90, 50, 250)
    fill(canvas, 406, 300, 90, 50, 250)
    return canvas


def _along_wall(k: int, low: Array, high: Array, rng: np.random.Generator) -> list[Surface]:
    """Furniture and pictures along a wall."""
    corner, right, inward, length = _wall_frame(k, low, high)
    height = float(high[2] - low[2])
    surfaces: list[Surface] = []
    along = 0.3
    while along < length - 1.5:
        width = float(rng.uniform(0.7, 1.3))
        kind = int(rng.integers(4))
        middle = corner + right * (along + width / 2)
        if kind == 0:
            size = (0.35, width, min(height - 0.3, 2.0))
            shelf = Texture(_books(rng, size[1], size[2]), _FINE)
            side = Texture(90 + 8 * fractal((512, 128), 64, rng), _FINE)
            surfaces += box([shelf, side], _standing(middle, inward, size[0]), size)
        elif kind == 1:
            size = (0.6, width, 0.75)
            desk = _table(middle, inward, size, rng)
            surfaces += desk
        board = kind != 0
        if board:
            high_board = float(rng.uniform(0.5, 0.9))
            bottom = min(1.1, height - high_board - 0.2)
            lift = np.array([0.0, 0.0, bottom])
            picture = Texture(_picture(rng, width, high_board), _FINE)
            edge = Texture(np.full((64, 64), 70.0), _FINE)
            T = _standing(middle + lift, inward, 0.04)
            surfaces += box([picture, edge], T, (0.04, width, high_board), light=inward)
        along += width + float(rng.uniform(0.15, 0.7))
    return surfaces


def _standing(foot: Array, facing: Array, depth: float) -> Array:
    """Pose of a box with its back at a point of a wall, that faces the room."""
    T = np.eye(4)
    T[:3, 0] = facing
    T[:3, 1] = [-facing[1], facing[0], 0.0]
    T[:3, 3] = foot + facing * (depth / 2 + 0.002)
    return T


def _books(rng: np.random.Generator, width: float, height: float) -> Field:
    """Shelves with the backs of books."""
    canvas = np.full((_up(height), _up(width)), 40.0, dtype=np.float32)
    pitch = round(0.33 * _FINE)
    for top in range(0, canvas.shape[0], pitch):
        x = 10
        while x < width * _FINE - 16:
            thick, high = int(rng.integers(6, 16)), int(rng.integers(45, 74))
            fill(canvas, x, top + pitch - high - 8, thick, high, rng.uniform(30, 225))
            if rng.random() < 0.6:
                y = top + pitch - high + int(rng.integers(0, 25))
                fill(canvas, x + 1, y, thick - 2, 8, rng.uniform(30, 240))
            x += thick + (1 if rng.random() < 0.85 else int(rng.integers(10, 40)))
        fill(canvas, 0, top + pitch - 8, canvas.shape[1], 8, 110)
    return canvas + 3 * rng.standard_normal(canvas.shape).astype(np.float32)


def _picture(rng: np.random.Generator, width: float, height: float) -> Field:
    """A poster with shapes and letters, or a checkerboard."""
    shape = (_up(height), _up(width))
    if rng.random() < 0.2:
        rows, columns = np.indices(shape) // 26
        return np.where((rows + columns) % 2 > 0, 225, 25).astype(np.float32)
    canvas = rng.uniform(60, 210) + 8 * fractal(shape, 64, rng)
    scribble(canvas, 45, rng)
    return canvas + 3 * fractal(shape, 4, rng)


def _table(
    foot: Array, facing: Array, size: tuple[float, float, float], rng: np.random.Generator
) -> list[Surface]:
    """Table with two sides, and a box on it."""
    depth, width, height = size
    T = _standing(foot, facing, depth)
    wood = Texture(120 + 14 * fractal((256, 512), 64, rng, persistence=0.6), _FINE)
    boards: list[Surface] = []
    for y in (-width / 2 + 0.03, width / 2 - 0.03):
        boards += box([wood], T @ _shifted(0, y, 0), (depth, 0.05, height - 0.04))
    boards += box([wood], T @ _shifted(0, 0, height - 0.04), (depth, width, 0.04))
    across = float(rng.uniform(-0.3, 0.3)) * width
    sides = [Texture(_picture(rng, 0.4, 0.4), _FINE) for _ in range(3)]
    return boards + box(sides, T @ _shifted(0, across, height), (0.25, 0.3, 0.25))


def _sliding_box(k: int, low: Array, high: Array, rng: np.random.Generator) -> MovingObject:
    sides = [Texture(_picture(rng, 0.7, 0.6), _FINE) for _ in range(5)]
    surfaces = SurfaceStack.of(box(sides, np.eye(4), (0.6, 0.5, 0.9)))
    middle, reach = (low + high) / 2, (high - low) / 2 - 1.2
    phase, period = rng.uniform(0, 2 * np.pi, 2), rng.uniform(9, 14)

    def pose(now: float) -> Array:
        turn = 2 * np.pi * now / period
        wave = np.sin([turn + phase[0] + k, 0.7 * turn + phase[1] + 2 * k])
        T = np.eye(4)
        yaw = 0.8 * np.sin(turn)
        T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        T[:3, 3] = [*(middle[:2] + reach[:2] * wave), low[2]]
        return T

    return MovingObject(surfaces, pose)


def _shifted(x: float, y: float, z: float) -> Array:
    T = np.eye(4)
    T[:3, 3] = [x, y, z]
    return T


def _up(metres: float) -> int:
    """Texels of a length, rounded up so that it can be halved six times."""
    return 64 * int(np.ceil(metres * _FINE / 64))
