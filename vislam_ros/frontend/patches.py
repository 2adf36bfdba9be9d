# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Small patches of an image, and where they are in another one, to hundredths of a pixel.

A patch is the neighbourhood of a point as it was seen once. It is laid over another image by an
affine map that follows from the geometry, and moved until both agree: the inverse compositional
method of Baker and Matthews, *Lucas-Kanade 20 Years On* (2004). A change of brightness and of
contrast is taken out of the gradients before (their "project out"), so exposure and the
difference between two cameras do not matter.

What is left of the differences tells the noise of the grey values, and with the gradients the
covariance of the place, as in any least-squares fit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]

#: Pixels that are compared, to each side of the point: 15 x 15.
HALF = 7
#: Pixels that are kept, to each side: room for a view from 1.6 times as near or as far.
REACH = 13
_SIDE = 2 * REACH + 1
_WINDOW = 2 * HALF + 1
_PIXELS = _WINDOW**2
# Gauss-Newton goes on to this step [px], and not longer than so many: they converge within five.
_SMALL_STEP, _MOST_STEPS = 0.01, 10
# Standard deviation of the slope of a disparity: a road under a stereo camera, whose baseline is
# a third of its height, has 0.3, and most surfaces less.
_SLOPE_STD = 0.2
# Whole grey values are rounded, which has this variance.
_ROUNDING = 1 / 12
# Share of the largest determinant under which an edge has no corner, for 32-bit numbers.
_SINGULAR = 1e-5


@dataclass(frozen=True)
class Patches:
    """Neighbourhoods of points in an image.

    Attributes
    ----------
    grey : ndarray of uint8, (n, 27, 27)
        About the whole pixel.
    fraction : ndarray of float32, (n, 2)
        Where the point lies beyond it, x and y, from 0 to 1.
    """

    grey: Grey
    fraction: Floats

    def __getitem__(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "Patches":
        """Some of them."""
        return Patches(self.grey[rows], self.fraction[rows])

    @classmethod
    def none(cls) -> "Patches":
        """No patches."""
        return cls(np.empty((0, _SIDE, _SIDE), np.uint8), np.empty((0, 2), np.float32))


@dataclass(frozen=True)
class Places:
    """Where patches are in an image.

    Attributes
    ----------
    points : ndarray of float32, (n, 2)
        x and y, pixels.
    covariance : ndarray of float32, (n, 3)
        Of x, of x and y, and of y, by the fit alone [px^2].
    correlation : ndarray of float32, (n,)
        Of the grey values, after the fit; -1 where there was none.
    slopes : ndarray of float32, (n, 2)
        How the shift of x grows along x and y, where it was asked for.
    """

    points: Floats
    covariance: Floats
    correlation: Floats
    slopes: Floats


def cut_patches(image: Grey, points: Floats) -> Patches:
    """Keep the neighbourhoods of points (n, 2) of an image (H, W); its rim is repeated outside."""
    patches = Patches(
        np.empty((len(points), _SIDE, _SIDE), np.uint8), np.empty((len(points), 2), np.float32)
    )
    _cut(image, np.ascontiguousarray(points, np.float32), patches.grey, patches.fraction)
    return patches


def joined(first: Patches, second: Patches) -> Patches:
    """Both, in this order."""
    return Patches(
        np.concatenate([first.grey, second.grey]),
        np.concatenate([first.fraction, second.fraction]),
    )


def fits(maps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether patches serve under affine maps (n, 2, 2): they are large and sharp enough.

    The sums of absolute values along the rows of a map tell where a window's corners come to lie.
    """
    corner = np.abs(maps).sum(axis=2).max(axis=1) * (HALF + 1)
    shrinks = np.abs(np.linalg.det(maps)) * (REACH / (HALF + 1)) ** 2
    return (corner < REACH - 1) & (shrinks > 1)


def place(
    patches: Patches,
    maps: NDArray[np.float64],
    image: Grey,
    guess: Floats,
    slopes: Floats | None = None,
) -> Places:
    """Find patches in an image, near a guess.

    Parameters
    ----------
    patches : Patches
    maps : ndarray, (n, 2, 2)
        From a step in this image to the step in the patch.
    image : ndarray of uint8, (H, W)
    guess : ndarray, (n, 2)
        Where they should be, to two or three pixels.
    slopes : ndarray of float32, (n, 2), optional
        What to expect of the slopes of a disparity, and then they are estimated, too: the image
        is the other one of a stereo pair.

    Returns
    -------
    Places
    """
    n = len(guess)
    with_slopes = slopes is not None
    found = Places(
        np.ascontiguousarray(guess, np.float32).copy(),
        np.zeros((n, 3), np.float32),
        np.full(n, -1, np.float32),
        np.zeros((n, 2), np.float32) if slopes is None else slopes.astype(np.float32),
    )
    _place(
        patches.grey,
        patches.fraction,
        np.ascontiguousarray(maps, np.float32),
        image,
        found.points,
        found.covariance,
        found.correlation,
        found.slopes,
        with_slopes,
    )
    return found


@compiled("void(uint8[:, ::1], float32[:, ::1], uint8[:, :, ::1], float32[:, ::1])")
def _cut(image: Grey, points: Floats, grey: Grey, fraction: Floats) -> None:
    height, width = image.shape
    for i in range(len(points)):
        column, row = int(np.floor(points[i, 0])), int(np.floor(points[i, 1]))
        fraction[i, 0], fraction[i, 1] = points[i, 0] - column, points[i, 1] - row
        for a in range(_SIDE):
            y = min(max(row + a - REACH, 0), height - 1)
            for b in range(_SIDE):
                grey[i, a, b] = image[y, min(max(column + b - REACH, 0), width - 1)]


@compiled("float32(uint8[:, ::1], float32, float32)")
def _between(image: Grey, x: Any, y: Any) -> Any:
    """Grey value between four pixels, all of which must be there."""
    column, row = int(x), int(y)
    right, down = np.float32(x - column), np.float32(y - row)
    upper = image[row, column] + right * (
        np.float32(image[row, column + 1]) - np.float32(image[row, column])
    )
    lower = image[row + 1, column] + right * (
        np.float32(image[row + 1, column + 1]) - np.float32(image[row + 1, column])
    )
    return np.float32(upper + down * (lower - upper))


@compiled("boolean(uint8[:, ::1], float32[::1], float32[:, ::1], float32[:, ::1])")
def _laid_over(grey: Grey, fraction: Floats, to_patch: Floats, wide: Floats) -> bool:
    """Grey values of a patch at the pixels of the other image; False where it is too small."""
    for a in range(_WINDOW + 2):
        for b in range(_WINDOW + 2):
            dx, dy = np.float32(b - HALF - 1), np.float32(a - HALF - 1)
            x = np.float32(REACH + fraction[0] + to_patch[0, 0] * dx + to_patch[0, 1] * dy)
            y = np.float32(REACH + fraction[1] + to_patch[1, 0] * dx + to_patch[1, 1] * dy)
            if not (0 <= x < _SIDE - 1 and 0 <= y < _SIDE - 1):
                return False
            wide[a, b] = _between(grey, x, y)
    return True


@compiled("float32(float32[:, ::1], float32[::1], float32[:, ::1])")
def _set_up(wide: Floats, pattern: Floats, gradients: Floats) -> Any:
    """Pattern less its mean, and gradients without brightness and contrast; its sum of squares."""
    for a in range(_WINDOW):
        for b in range(_WINDOW):
            k = a * _WINDOW + b
            pattern[k] = wide[a + 1, b + 1]
            gradients[0, k] = np.float32(0.5) * (wide[a + 1, b + 2] - wide[a + 1, b])
            gradients[1, k] = np.float32(0.5) * (wide[a + 2, b + 1] - wide[a, b + 1])
            gradients[2, k] = gradients[0, k] * np.float32(b - HALF)
            gradients[3, k] = gradients[0, k] * np.float32(a - HALF)
    level = np.float32(0)
    for k in range(_PIXELS):
        level += pattern[k]
    level /= np.float32(_PIXELS)
    for k in range(_PIXELS):
        pattern[k] -= level
    contrast = np.dot(pattern, pattern)
    if contrast > 0:
        shares = np.dot(gradients, pattern)
        for j in range(4):
            level = np.float32(0)
            for k in range(_PIXELS):
                level += gradients[j, k]
            level /= np.float32(_PIXELS)
            share = np.float32(shares[j] / contrast)
            for k in range(_PIXELS):
                gradients[j, k] -= level + share * pattern[k]
    return contrast


@compiled("boolean(uint8[:, ::1], float32[::1], float32[::1], float32[::1])")
def _sample(image: Grey, point: Floats, slope: Floats, seen: Floats) -> bool:
    """Grey values about a point, less their mean; False where the image ends."""
    height, width = image.shape
    spread = np.float32(HALF) * (1 + abs(slope[0]) + abs(slope[1]))
    across = point[0] - spread >= 0 and point[0] + spread < width - 1
    # Written so that a NaN fails.
    if not (across and point[1] - HALF >= 0 and point[1] + HALF < height - 1):
        return False
    if slope[0] == 0 and slope[1] == 0:
        # All pixels lie alike between their neighbours.
        column, row = int(point[0]) - HALF, int(point[1]) - HALF
        right, down = point[0] - np.floor(point[0]), point[1] - np.floor(point[1])
        w11 = np.float32(right * down)
        w10, w01 = np.float32(down - w11), np.float32(right - w11)
        w00 = np.float32(1 - right - w10)
        for a in range(_WINDOW):
            upper = image[row + a, column : column + _WINDOW + 1]
            lower = image[row + a + 1, column : column + _WINDOW + 1]
            for b in range(_WINDOW):
                seen[a * _WINDOW + b] = (
                    w00 * np.float32(upper[b])
                    + w01 * np.float32(upper[b + 1])
                    + w10 * np.float32(lower[b])
                    + w11 * np.float32(lower[b + 1])
                )
    else:
        for a in range(_WINDOW):
            for b in range(_WINDOW):
                dx, dy = np.float32(b - HALF), np.float32(a - HALF)
                x = np.float32(point[0] + dx + slope[0] * dx + slope[1] * dy)
                seen[a * _WINDOW + b] = _between(image, x, np.float32(point[1] + dy))
    level = np.float32(0)
    for k in range(_PIXELS):
        level += seen[k]
    level /= np.float32(_PIXELS)
    for k in range(_PIXELS):
        seen[k] -= level
    return True


@compiled("void(float32[:, ::1], float32[::1], float32[::1])")
def _solve(A: Floats, b: Floats, x: Floats) -> None:
    """Solve A x = b by elimination, in place: A (4, 4) is symmetric and positive."""
    for j in range(4):
        for i in range(j + 1, 4):
            share = A[i, j] / A[j, j]
            b[i] -= share * b[j]
            for k in range(j, 4):
                A[i, k] -= share * A[j, k]
    for i in range(3, -1, -1):
        rest = b[i]
        for k in range(i + 1, 4):
            rest -= A[i, k] * x[k]
        x[i] = rest / A[i, i]


@compiled(
    "void(uint8[:, :, ::1], float32[:, ::1], float32[:, :, ::1], uint8[:, ::1], float32[:, ::1],"
    "float32[:, ::1], float32[::1], float32[:, ::1], boolean)"
)
def _place(
    grey: Grey,
    fraction: Floats,
    maps: Floats,
    image: Grey,
    points: Floats,
    covariance: Floats,
    correlation: Floats,
    slopes: Floats,
    with_slopes: bool,
) -> None:
    wide = np.empty((_WINDOW + 2, _WINDOW + 2), np.float32)
    pattern, seen = np.empty(_PIXELS, np.float32), np.empty(_PIXELS, np.float32)
    # By x, by y, and by the two slopes of x.
    gradients = np.empty((4, _PIXELS), np.float32)
    slope_weight = np.float32(1 / _SLOPE_STD**2)
    A, b = np.empty((4, 4), np.float32), np.empty(4, np.float32)
    move = np.empty(4, np.float32)
    for i in range(len(points)):
        if not _laid_over(grey[i], fraction[i], maps[i], wide):
            continue
        contrast = _set_up(wide, pattern, gradients)
        H = np.dot(gradients, gradients.T)
        determinant = H[0, 0] * H[1, 1] - H[0, 1] * H[0, 1]
        if not (contrast > 0 and determinant > _SINGULAR * H[0, 0] * H[1, 1]):
            continue
        point, slope = points[i].copy(), slopes[i].copy()
        noise, likeness = np.float32(0), np.float32(-1)
        for _ in range(_MOST_STEPS):
            if not _sample(image, point, slope, seen):
                likeness = np.float32(-1)
                break
            energy, common = np.dot(seen, seen), np.dot(seen, pattern)
            gain = common / contrast
            if not gain > 0:
                likeness = np.float32(-1)
                break
            likeness = common / np.sqrt(contrast * energy)
            # Variance of the patch's grey values: what brightness and contrast leave.
            noise = max(energy - gain * common, np.float32(0)) / (gain * gain * (_PIXELS - 2))
            g = np.dot(gradients, seen) / gain
            if with_slopes:
                prior = np.float32(max(noise, _ROUNDING)) * slope_weight
                A[:] = H
                b[:] = g
                for j in range(2):
                    A[j + 2, j + 2] += prior
                    b[j + 2] += prior * (slope[j] - slopes[i, j])
                _solve(A, b, move)
                stretch = 1 + slope[0]
                point[0] -= stretch * move[0] + slope[1] * move[1]
                point[1] -= move[1]
                slope[0] -= stretch * move[2]
                slope[1] -= stretch * move[3]
                size = move[0] * move[0] + move[1] * move[1]
            else:
                across = (H[1, 1] * g[0] - H[0, 1] * g[1]) / determinant
                along = (H[0, 0] * g[1] - H[0, 1] * g[0]) / determinant
                point[0] -= across
                point[1] -= along
                size = across * across + along * along
            if size < _SMALL_STEP * _SMALL_STEP:
                break
        correlation[i] = likeness
        if likeness > 0:
            points[i], slopes[i] = point, slope
            covariance[i, 0] = noise * H[1, 1] / determinant
            covariance[i, 1] = -noise * H[0, 1] / determinant
            covariance[i, 2] = noise * H[0, 0] / determinant
