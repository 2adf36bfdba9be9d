# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Textures of a street: the road, fronts of houses, walls, cars, and the horizon."""

from collections.abc import Callable

import cv2
import numpy as np

from vislam_ros.data.simulation.images.texture import (
    Field,
    Texture,
    bricks,
    fill,
    fractal,
    letters,
    stripes,
)

PER_METRE = 64

#: The road's texture goes on for so long before it repeats, and reaches so far to the right and to
#: the left of the line that the car follows, metres.
ROAD_PERIOD, ROAD_RIGHT, ROAD_LEFT = 48, 9, 11
#: Kerbs, from that line to the left, metres.
KERBS = (-4.5, 7.3)

_LANE_LINES = (-1.75, 5.2)  # whole ones
_MIDDLE_LINE = 1.75  # dashed

#: The backdrop has so many faces around, and reaches from there to there (tangents).
BACKDROP_FACES, BACKDROP_LOW, BACKDROP_HIGH = 12, -0.25, 1.0
BACKDROP_PER_UNIT = 768
FAR_GREY, SKY_GREY = 112, 205


def road(rng: np.random.Generator) -> Texture:
    """Lanes with marks, patches, cracks and covers, and pavements of slabs; ``u`` goes ahead."""
    width, height = ROAD_PERIOD * PER_METRE, (ROAD_RIGHT + ROAD_LEFT) * PER_METRE

    def row(left: float) -> float:
        return (ROAD_LEFT - left) * PER_METRE

    canvas = 92 + 9 * fractal((height, width), 256, rng) + 6 * fractal((height, width), 2, rng)
    for _ in range(24):
        x, y = rng.uniform(0, width), rng.uniform(row(KERBS[1]), row(KERBS[0]))
        length, across, grey = rng.uniform(0.5, 5), rng.uniform(0.3, 1.6), rng.normal(0, 16)
        rows = slice(round(y), round(y + across * PER_METRE))
        canvas[rows, round(x) : round(x + length * PER_METRE)] += grey
    for _ in range(36):
        steps = rng.normal(0, 1, (rng.integers(6, 30), 2)) * 10 + rng.normal(0, 8, 2)
        line = np.cumsum(steps, axis=0) + rng.uniform(0, 1, 2) * [width, height]
        cv2.polylines(canvas, [np.rint(line).astype(np.int32)], False, 52.0, 2, cv2.LINE_AA)
    for _ in range(7):
        centre = (int(rng.uniform(64, width - 64)), int(row(rng.uniform(-3, 6))))
        cv2.circle(canvas, centre, 20, 60.0, -1, cv2.LINE_AA)
        cv2.circle(canvas, centre, 20, 130.0, 2, cv2.LINE_AA)
        cv2.line(canvas, (centre[0] - 12, centre[1]), (centre[0] + 12, centre[1]), 120.0, 3)

    _marks(canvas, row)
    for kerb, far in ((KERBS[0], -float(ROAD_RIGHT)), (KERBS[1], float(ROAD_LEFT))):
        first, last = sorted((round(row(kerb)), round(row(far))))
        slabs = bricks((last - first, width), (32, 48), rng, grey=138, spread=9)
        canvas[first:last] = slabs + 5 * fractal((height, width), 64, rng)[first:last]
        fill(canvas, 0, row(kerb) - 6, width, 12, 178)
        canvas[round(row(kerb)) - 6 : round(row(kerb)) + 6, ::PER_METRE] = 90
    return Texture(canvas, PER_METRE)


def _marks(canvas: Field, row: Callable[[float], float]) -> None:
    width = canvas.shape[1]
    white = np.zeros(canvas.shape, dtype=np.bool_)
    for line in _LANE_LINES:
        fill(white, 0, row(line) - 4, width, 8, True)
    for x in range(0, width, 6 * PER_METRE):
        fill(white, x, row(_MIDDLE_LINE) - 4, 3 * PER_METRE, 8, True)
    for k in range(11):
        fill(white, 30 * PER_METRE, row(5.0) + k * 40, 3 * PER_METRE, 22, True)
    for x in range(0, 24 * PER_METRE, 6 * PER_METRE):
        fill(white, x, row(KERBS[1]), 6, 2 * PER_METRE, True)
    # Marks are worn where the asphalt is rough.
    under = canvas[white]
    canvas[white] += np.clip((under - 70) / 25, 0, 1) * (215 - under)


def front(rng: np.random.Generator) -> Texture:
    """Front of a house of four floors, 16 m wide and 12 m high."""
    height, width = 12 * PER_METRE, 16 * PER_METRE
    floor = 3 * PER_METRE
    grey = rng.uniform(95, 185)
    if rng.random() < 0.5:
        canvas = bricks((height, width), (8, 16), rng, grey=0.75 * grey, spread=11)
    else:
        canvas = np.full((height, width), grey, dtype=np.float32)
    canvas += 7 * fractal((height, width), 128, rng) + 5 * fractal((height, width), 8, rng)

    pitch = PER_METRE * int(rng.choice([2, 3, 4]))
    wide = pitch * rng.uniform(0.4, 0.6)
    high = floor * rng.uniform(0.45, 0.6)
    trim, pane = rng.uniform(170, 230), rng.uniform(25, 60)
    bars = int(rng.integers(1, 3))
    for top in range(0, height, floor):
        fill(canvas, 0, top, width, 7, trim - 50)
        shop = top == height - floor
        for left in range(0, width, pitch):
            x, y = left + (pitch - wide) / 2, top + 0.25 * floor
            deep = floor * 0.75 if shop and rng.random() < 0.4 else high
            _window(canvas, (x, y, wide, deep), trim, pane, bars, rng)
    fill(canvas, 0, 0, width, 16, trim)
    for x in range(0, width, 24):
        fill(canvas, x, 16, 10, 8, trim - 20)
    fill(canvas, 0, height - 20, width, 20, 70)
    _soil(canvas, rng)
    return Texture(canvas, PER_METRE)


def _window(
    canvas: Field,
    place: tuple[float, float, float, float],
    trim: float,
    pane: float,
    bars: int,
    rng: np.random.Generator,
) -> None:
    x, y, wide, high = place
    fill(canvas, x - 8, y - 8, wide + 16, high + 16, trim)
    fill(canvas, x, y, wide, high, pane + rng.uniform(-15, 25))
    if rng.random() < 0.5:
        share = rng.uniform(0.2, 0.5)
        fill(canvas, x, y, wide * share, high, rng.uniform(110, 200))
    if rng.random() < 0.4:
        fill(canvas, x, y, wide, high * rng.uniform(0.1, 0.6), rng.uniform(90, 220))
    for k in range(1, bars + 1):
        fill(canvas, x + wide * k / (bars + 1) - 3, y, 6, high, trim)
    fill(canvas, x, y + high / 3, wide, 5, trim)
    fill(canvas, x - 14, y + high + 8, wide + 28, 9, trim - 60)


def _soil(canvas: Field, rng: np.random.Generator) -> None:
    """Darken a wall toward its foot, and in streaks."""
    height, width = canvas.shape
    streaks = fractal((64, width), 64, rng)[:1]
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    canvas *= 1 - 0.15 * down * (1 + 0.5 * np.clip(streaks, -1, 1))


def gable(rng: np.random.Generator) -> Texture:
    """Side of a house, without windows."""
    shape = (12 * PER_METRE, 8 * PER_METRE)
    canvas = bricks(shape, (8, 16), rng, grey=rng.uniform(80, 130), spread=13)
    canvas += 10 * fractal(shape, 128, rng)
    _soil(canvas, rng)
    return Texture(canvas, PER_METRE)


def hedge(rng: np.random.Generator) -> Texture:
    """Leaves, 8 m long and 2 m high."""
    return Texture(62 + 26 * fractal((2 * PER_METRE, 8 * PER_METRE), 32, rng, persistence=0.9), 64)


def fence(rng: np.random.Generator) -> Texture:
    """Boards that look all alike, 8 m long and 2 m high."""
    shape = (2 * PER_METRE, 8 * PER_METRE)
    canvas = stripes(shape, 16, 12, 45, 165) + 6 * fractal(shape, 64, rng)
    fill(canvas, 0, 24, shape[1], 8, 120)
    fill(canvas, 0, 96, shape[1], 8, 120)
    return Texture(canvas, PER_METRE)


def post(rng: np.random.Generator) -> Texture:
    """Metal of a lamp post or a sign."""
    return Texture(120 + 12 * fractal((512, 64), 64, rng), 128)


def sign(rng: np.random.Generator) -> Texture:
    """A traffic sign, 64 cm wide and high."""
    canvas = np.full((64, 64), 225, dtype=np.float32)
    cv2.rectangle(canvas, (2, 2), (61, 61), 40.0, 4)
    text = str(int(rng.integers(10, 99)))
    letters(canvas, text, (9, 45), 27, 20.0)
    return Texture(canvas, 100)


def car_body(rng: np.random.Generator) -> tuple[Texture, Texture, Texture]:
    """End, side (4.2 m) and top of the lower part of a car, 0.8 m high."""
    paint = float(rng.uniform(40, 225))
    end = np.full((64, 128), paint, dtype=np.float32)
    end += 3 * fractal((64, 128), 64, rng)
    for x in (4, 100):
        fill(end, x, 14, 24, 14, 245 if paint < 140 else 30)
    fill(end, 44, 30, 40, 12, 235)
    letters(end, "B 123", (47, 40), 8, 10.0)
    fill(end, 0, 48, 128, 16, 35)
    side = np.full((64, 320), paint, dtype=np.float32)
    side += 3 * fractal((64, 320), 64, rng)
    fill(side, 0, 50, 320, 14, 38)
    for x in (60, 235):
        cv2.circle(side, (x, 44), 26, 22.0, -1, cv2.LINE_AA)
        cv2.circle(side, (x, 44), 14, 150.0, 3, cv2.LINE_AA)
    for x in (100, 160, 215):
        fill(side, x, 0, 2, 46, paint * 0.6)
    top = np.full((128, 320), min(paint * 1.1, 250), dtype=np.float32)
    return Texture(end, 72), Texture(side, 76), Texture(top + fractal((128, 320), 64, rng), 76)


def car_cabin(rng: np.random.Generator) -> tuple[Texture, Texture]:
    """Windscreen and side windows of a car, 0.6 m high."""
    screen = 40 + 10 * fractal((64, 128), 64, rng)
    fill(screen, 0, 0, 128, 6, 170)
    fill(screen, 30, 30, 22, 30, 90)
    side = 45 + 10 * fractal((64, 256), 64, rng)
    for x in (0, 90, 170, 248):
        fill(side, x, 0, 9, 64, 165)
    fill(side, 0, 0, 256, 8, 165)
    return Texture(screen, 80), Texture(side, 100)


def backdrop(rng: np.random.Generator) -> Texture:
    """Sky with clouds over hills, towers and trees, all the way round."""
    width = BACKDROP_FACES * 384
    height = int((BACKDROP_HIGH - BACKDROP_LOW) * BACKDROP_PER_UNIT)
    horizon = int(BACKDROP_HIGH * BACKDROP_PER_UNIT)
    y = np.arange(height)[:, None]
    clouds = fractal((1024, width), 128, rng, persistence=0.5)[:height]
    thinner = np.linspace(14, 6, height, dtype=np.float32)[:, None]
    canvas: Field = SKY_GREY + np.clip(clouds * thinner, -20, 30)
    for base, rough, grey in ((90, 30, 165.0), (45, 16, 135.0)):
        ridge = base + rough * fractal((256, width), 256, rng, persistence=0.45)[0]
        land = y > horizon - ridge
        canvas[land] = grey + 4 * clouds[land]
    for _ in range(60):
        x, wide, high = rng.uniform(0, width), rng.uniform(16, 50), rng.uniform(40, 150)
        grey = rng.uniform(95, 150)
        fill(canvas, x, horizon - high, wide, high + 30, grey)
        for row in range(round(horizon - high) + 5, horizon, 10):
            canvas[row : row + 5, round(x) + 3 : round(x + wide) - 2 : 7] -= 35
            canvas[row : row + 5, round(x) + 4 : round(x + wide) - 2 : 7] -= 35
    crowns = 26 + 12 * fractal((64, width), 64, rng, persistence=0.75)[0]
    leaves = 82 + 16 * fractal((1024, width), 32, rng, persistence=0.85)[:height]
    canvas = np.where(y > horizon - crowns, leaves, canvas)
    return Texture(np.where(y > horizon + 60, FAR_GREY, canvas), BACKDROP_PER_UNIT)
