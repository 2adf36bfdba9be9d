# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of surfaces, and the patterns that they are made of."""

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Field = NDArray[np.float32]


class Texture:
    """Picture of a surface, kept in every sharpness that a view of it may need.

    Halved along its rows and along its columns apart from each other (a ripmap; McReynolds and
    Blythe, *Advanced Graphics Programming Using OpenGL*, 2005, chapter 14), for a road seen at a
    grazing angle is far denser in one direction than in the other. It repeats in both directions.

    Parameters
    ----------
    picture : ndarray, (h, w)
        Grey, 0 to 255; halved as often as its sides can be.
    per_metre : float
        Texels a metre.
    """

    def __init__(self, picture: NDArray[np.floating] | Grey, per_metre: float) -> None:
        grey = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        self.per_metre = per_metre
        self._levels: dict[tuple[int, int], Grey] = {(0, 0): grey}
        height, width = grey.shape
        self._most = (_halvings(width), _halvings(height))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, texels."""
        height, width = self._levels[0, 0].shape
        return width, height

    def nearest_level(self, footprint_u: float, footprint_v: float) -> tuple[int, int]:
        """Level whose texels are as large as a pixel's footprint (texels), or a little smaller."""
        levels = np.floor(np.log2(np.maximum([footprint_u, footprint_v], 1.0))).astype(int)
        return min(int(levels[0]), self._most[0]), min(int(levels[1]), self._most[1])

    def level(self, level: tuple[int, int]) -> Grey:
        """Picture that is halved so often along its rows and its columns."""
        if level not in self._levels:
            u, v = level
            finer = self.level((u - 1, v) if u > 0 else (u, v - 1))
            height, width = finer.shape
            size = (width // 2, height) if u > 0 else (width, height // 2)
            self._levels[level] = np.asarray(
                cv2.resize(finer, size, interpolation=cv2.INTER_AREA), dtype=np.uint8
            )
        return self._levels[level]


def _halvings(length: int) -> int:
    return (length & -length).bit_length() - 1


def fractal(
    shape: tuple[int, int], coarsest: int, rng: np.random.Generator, *, persistence: float = 0.7
) -> Field:
    """Noise of all scales from ``coarsest`` texels down to one, that repeats seamlessly.

    Its standard deviation is about 1. Each scale of half the size has ``persistence`` times the
    amplitude (Perlin, *An image synthesizer*, SIGGRAPH 1985, of values in place of gradients).

    Parameters
    ----------
    shape : tuple of int, (2,)
        Height and width, multiples of ``coarsest``.
    coarsest : int
        A power of two, texels.
    rng : Generator
    persistence : float
    """
    height, width = shape
    total = rng.standard_normal((height // coarsest, width // coarsest), dtype=np.float32)
    amplitude, power, cell = 1.0, 1.0, coarsest
    while cell > 1:
        cell, amplitude = cell // 2, amplitude * persistence
        total = _doubled(total)
        total += np.float32(amplitude) * rng.standard_normal(total.shape, dtype=np.float32)
        power += amplitude**2
    total /= np.float32(np.sqrt(power))
    return total


def _doubled(grid: Field) -> Field:
    """Twice as large, by cubic interpolation of a grid that goes on with its other end."""
    edge = 2
    wide = np.pad(grid, edge, mode="wrap")
    size = (wide.shape[1] * 2, wide.shape[0] * 2)
    large = np.asarray(cv2.resize(wide, size, interpolation=cv2.INTER_CUBIC), dtype=np.float32)
    return large[2 * edge : -2 * edge, 2 * edge : -2 * edge]


def bricks(
    shape: tuple[int, int],
    brick: tuple[int, int],
    rng: np.random.Generator,
    *,
    grey: float = 120.0,
    spread: float = 18.0,
) -> Field:
    """Courses of bricks or slabs (height and width in texels), each of its own grey."""
    rows, columns = np.indices(shape, sparse=True)
    course, y = np.divmod(rows, brick[0])
    across, x = np.divmod(columns + (course % 2) * (brick[1] // 2), brick[1])
    shades = rng.standard_normal((shape[0] // brick[0] + 1, shape[1] // brick[1] + 2))
    joint = max(brick[0] // 10, 1)
    picture = grey + spread * shades[course, across]
    picture[(y < joint) | (x < joint)] = grey + 1.5 * spread
    return (picture + 6.0 * rng.standard_normal(shape)).astype(np.float32)


def stripes(shape: tuple[int, int], pitch: int, width: int, dark: float, light: float) -> Field:
    """Upright light stripes on dark, that repeat every ``pitch`` texels."""
    row = np.where(np.arange(shape[1]) % pitch < width, light, dark)
    return np.tile(row.astype(np.float32), (shape[0], 1))


def fill(
    canvas: Field | NDArray[np.bool_], x: float, y: float, width: float, height: float, grey: float
) -> None:
    """Paint a rectangle, all in texels."""
    x0, y0 = max(round(x), 0), max(round(y), 0)
    canvas[y0 : max(round(y + height), 0), x0 : max(round(x + width), 0)] = grey


def scribble(canvas: Field, count: int, rng: np.random.Generator) -> None:
    """Paint random shapes and letters over a canvas, as on a poster."""
    height, width = canvas.shape
    for _ in range(count):
        grey = float(rng.uniform(15, 245))
        x, y = int(rng.integers(width)), int(rng.integers(height))
        size = int(rng.uniform(0.03, 0.2) * min(width, height)) + 2
        kind = rng.integers(4)
        if kind == 0:
            cv2.circle(canvas, (x, y), size, grey, -1, cv2.LINE_AA)
        elif kind == 1:
            fill(canvas, x, y, size * rng.uniform(0.5, 3), size * rng.uniform(0.5, 2), grey)
        elif kind == 2:
            end = (int(rng.integers(width)), int(rng.integers(height)))
            cv2.line(canvas, (x, y), end, grey, max(size // 8, 1), cv2.LINE_AA)
        else:
            text = "".join(chr(int(c)) for c in rng.integers(65, 91, 4))
            letters(canvas, text, (x - size, y), size, grey)


def letters(canvas: Field, text: str, foot: tuple[int, int], height: int, grey: float) -> None:
    """Write a text whose letters are about as high, and whose first one stands there (texels)."""
    ink = np.zeros(canvas.shape, dtype=np.uint8)
    thick = max(height // 7, 1)
    cv2.putText(ink, text, foot, cv2.FONT_HERSHEY_SIMPLEX, height / 21, 255, thick, cv2.LINE_AA)
    canvas += ink * np.float32(1 / 255) * (grey - canvas)
