# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A street along a drive: road, houses, hedges, parked cars, posts, and cars that move."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.simulation.images import street_textures as textures
from vislam_ros.data.simulation.images.centre_line import CentreLine
from vislam_ros.data.simulation.images.scene import MovingObject, Scene
from vislam_ros.data.simulation.images.surfaces import (
    Layer,
    Surface,
    SurfaceStack,
    box,
    rectangle,
    triangle,
)
from vislam_ros.data.simulation.images.texture import Texture

Array = NDArray[np.float64]

#: Height of the body over the road, metres.
BODY_HEIGHT = 1.1

_BEFORE, _AHEAD = 20.0, 100.0  # metres of street around the drive
_CLEAR = 7.0  # metres from any part of the way where no house stands
_ONCOMING_SPEED = 8.0  # metres a second


def street(T_world_body: Array, seconds: Array, *, moving: int, rng: np.random.Generator) -> Scene:
    """Build a street along a drive.

    Parameters
    ----------
    T_world_body : ndarray, (n, 4, 4)
        The drive.
    seconds : ndarray, (n,)
        Its times, from 0 on.
    moving : int
        Cars that move: the first one drives ahead, the others come the other way.
    rng : Generator
    """
    line = CentreLine(T_world_body, body_height=BODY_HEIGHT, before=_BEFORE, after=_AHEAD)
    surfaces = [*_backdrop(rng), *_road(line, textures.road(rng))]
    for side in (1, -1):
        surfaces += _houses(line, side, rng)
        surfaces += _posts(line, side, rng)
    surfaces += _parked(line, rng)
    cars = tuple(_moving_car(k, line, T_world_body, seconds, rng) for k in range(moving))
    return Scene(SurfaceStack.of(surfaces), cars, textures.FAR_GREY)


def _backdrop(rng: np.random.Generator) -> list[Surface]:
    """Faces of a prism around the camera, which goes with it."""
    texture = textures.backdrop(rng)
    faces = textures.BACKDROP_FACES
    width = texture.size[0] / faces
    half = np.pi / faces
    radius = width / texture.per_metre / 2 / np.tan(half)
    height = (textures.BACKDROP_HIGH - textures.BACKDROP_LOW) * radius
    surfaces = []
    for k in range(faces):
        angles = -2 * k * half + np.array([half, -half])
        corners = radius / np.cos(half) * np.column_stack([np.cos(angles), np.sin(angles)])
        top_left = [*corners[0], textures.BACKDROP_HIGH * radius]
        right, down = [*(corners[1] - corners[0]), 0.0], [0.0, 0.0, -height]
        start = (k * width, 0.0)
        surfaces.append(
            rectangle(texture, top_left, right, down, start=start, layer=Layer.BACKDROP)
        )
    return surfaces


def _road(line: CentreLine, texture: Texture) -> list[Surface]:
    """Strips of road from point to point, the farthest first."""
    per_metre = texture.per_metre
    right, left = -float(textures.ROAD_RIGHT), float(textures.ROAD_LEFT)
    strips: list[Surface] = []
    for a, b in zip(line.ways[:-1], line.ways[1:], strict=True):
        corners = line.place(np.array([a, b, b, a]), np.array([left, left, right, right]))
        start = a % textures.ROAD_PERIOD
        u = np.array([start, start + b - a, start + b - a, start]) * per_metre
        v = np.array([0.0, 0.0, left - right, left - right]) * per_metre
        texels = np.column_stack([u, v])
        strips += [
            triangle(texture, corners[rows], texels[rows], layer=Layer.FLOOR)
            for rows in ([0, 1, 2], [0, 2, 3])
        ]
    return strips[::-1]


def _houses(line: CentreLine, side: int, rng: np.random.Generator) -> list[Surface]:
    fronts = [textures.front(rng) for _ in range(4)]
    gable, low = textures.gable(rng), [textures.hedge(rng), textures.fence(rng)]
    edge = float(textures.ROAD_LEFT if side > 0 else textures.ROAD_RIGHT)
    surfaces: list[Surface] = []
    way = float(line.ways[0])
    while way < line.ways[-1]:
        length, back = rng.uniform(9, 16), edge - rng.uniform(0.1, 1.0)
        height = rng.choice([6.0, 9.0, 12.0])
        texture = fronts[rng.integers(len(fronts))]
        a, b = line.place(np.array([way, way + length]), side * np.array([back, back]))
        surfaces += _house(a, b, side, height, texture, gable, line)
        way += length
        if rng.random() < 0.6:
            gap = rng.uniform(2, 9)
            a, b = line.place(np.array([way, way + gap]), side * np.array([edge, edge]))
            surfaces += _wall(a, b, side, 2.0, low[rng.integers(2)], line)
            way += gap
    return surfaces


def _house(
    a: Array, b: Array, side: int, height: float, front: Texture, gable: Texture, line: CentreLine
) -> list[Surface]:
    """Front between two points on the ground, and both gables behind it."""
    surfaces = _wall(a, b, side, height, front, line)
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    behind = side * 8.0 * np.array([-along[1], along[0], 0.0])
    for near, far, facing in ((a, a + behind, side), (b + behind, b, side)):
        surfaces += _wall(near, far, -facing, height, gable, line, shade=0.8)
    return surfaces


def _wall(
    a: Array,
    b: Array,
    side: int,
    height: float,
    texture: Texture,
    line: CentreLine,
    shade: float = 1.0,
) -> list[Surface]:
    """Upright wall from a to b, seen from the right of that way where side is 1."""
    length = float(np.linalg.norm((b - a)[:2]))
    points = a + np.linspace(0, 1, 9)[:, None] * (b - a)
    if length < 0.5 or line.distance(points) < _CLEAR:
        return []
    left, right = (a, b) if side > 0 else (b, a)
    foot = min(a[2], b[2]) - 0.5
    top_left = np.array([left[0], left[1], foot + 0.5 + height])
    down = np.array([0.0, 0.0, -height - 0.5])
    # The foot of the picture stands on the ground, and its top is cut where the wall is lower.
    start = (0.0, texture.size[1] - height * texture.per_metre)
    return [
        rectangle(texture, top_left, (right - left) * [1, 1, 0], down, start=start, shade=shade)
    ]


def _posts(line: CentreLine, side: int, rng: np.random.Generator) -> list[Surface]:
    metal, kerb = textures.post(rng), abs(textures.KERBS[1 if side > 0 else 0]) + 0.6
    surfaces: list[Surface] = []
    for way in np.arange(line.ways[0] + rng.uniform(0, 10), line.ways[-1], 19.0):
        T = line.pose(float(way), side * kerb)
        surfaces += box([metal], T, (0.14, 0.14, 5.5))
        if rng.random() < 0.6:
            lift = np.eye(4)
            lift[:3, 3] = [-0.12, 0.0, rng.uniform(2.0, 2.6)]
            surfaces += box(
                [metal, metal, textures.sign(rng), metal], T @ lift, (0.04, 0.64, 0.64)
            )
    return surfaces


def _parked(line: CentreLine, rng: np.random.Generator) -> list[Surface]:
    surfaces: list[Surface] = []
    for left, back in ((6.2, True), (-3.35, False)):
        way = float(line.ways[0]) + 5.0
        while way < line.ways[-1]:
            way += rng.uniform(5.5, 8) if rng.random() < 0.5 else rng.uniform(12, 30)
            T = line.pose(way, left, back=back)
            if line.distance(T[None, :3, 3]) > 2.8:
                surfaces += car(T, rng)
    return surfaces


def car(T_world_car: Array, rng: np.random.Generator) -> list[Surface]:
    """A car of two boxes, 4.2 m long and 1.4 m high, its front along x."""
    end, side, top = textures.car_body(rng)
    screen, window = textures.car_cabin(rng)
    cabin = T_world_car.copy()
    cabin[:3, 3] += T_world_car[:3, :3] @ [-0.3, 0.0, 0.82]
    return [
        *box([end, side, end, side, top], T_world_car, (4.2, 1.75, 0.82)),
        *box([screen, window, screen, window, top], cabin, (2.4, 1.5, 0.6)),
    ]


def _moving_car(
    k: int, line: CentreLine, T_world_body: Array, seconds: Array, rng: np.random.Generator
) -> MovingObject:
    surfaces = SurfaceStack.of(car(np.eye(4), rng))
    if k == 0:
        steps = np.linalg.norm(np.diff(T_world_body[:, :2, 3], axis=0), axis=1)
        gone = np.concatenate([[0.0], np.cumsum(steps)])

        def ahead(now: float) -> Array:
            gap = 17 + 5 * np.sin(2 * np.pi * now / 13)
            return line.pose(float(np.interp(now, seconds, gone)) + gap, 0.0)

        return MovingObject(surfaces, ahead)
    start = 25.0 + k * 45.0 + rng.uniform(-5, 5)

    def oncoming(now: float) -> Array:
        return line.pose(start - _ONCOMING_SPEED * now, 3.4, back=True)

    return MovingObject(surfaces, oncoming)
