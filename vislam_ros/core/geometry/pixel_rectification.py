# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pixels of any two pinhole cameras side by side, as the rectified pair would have seen them.

A pixel is a ray, and turning a camera about its centre turns its rays and moves nothing else
(Hartley and Zisserman, *Multiple View Geometry*, section 8.4.2): ``z' = K' R K^-1 z`` holds for
points at all depths. Both cameras are turned until the baseline is the x axis of both, the left
one no more than that takes, and both get the left one's intrinsics.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# Pixels that move by less are where they should be: calibrations are rounded.
_SAME_PIXELS = 1e-3
# Cosine of 45 degrees, the guard: cameras that are farther apart in what they look at, or stand
# more in line than side by side, are no stereo pair.
_LEAST_COSINE = np.sqrt(0.5)


class NoStereoPairError(VislamError):
    """Two cameras that do not stand side by side, the right one to the right."""


class Intrinsics(NamedTuple):
    """Focal lengths and principal point of a pinhole camera, pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of_matrix(cls, K: Array) -> "Intrinsics":
        """Of a matrix (3, 3) or (3, 4) whose other entries do not count."""
        return cls(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))


@dataclass(frozen=True)
class ImageTurn:
    """How one image's pixels move: ``K' R K^-1``.

    Attributes
    ----------
    before, after : Intrinsics
    R_after_before : tuple of 9 float, or None
        Row by row; None where the axes stay.
    """

    before: Intrinsics
    after: Intrinsics
    R_after_before: tuple[float, ...] | None = None

    def moved(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Pixels (n,) and (n,) after the turn; NaN where they would end behind the camera."""
        before, after = self.before, self.after
        x, y = (u - before.cx) / before.fx, (v - before.cy) / before.fy
        if self.R_after_before is not None:
            # Sums of their own: the bits must not depend on how many pixels there are.
            a, b, c, d, e, f, g, h, i = self.R_after_before
            depth = g * x + h * y + i
            depth[~(depth > 0)] = np.nan
            x, y = (a * x + b * y + c) / depth, (d * x + e * y + f) / depth
        return after.fx * x + after.cx, after.fy * y + after.cy


@dataclass(frozen=True)
class PixelRectification:
    """What each of the two images' pixels go through; None where they stay as they are."""

    left: ImageTurn | None
    right: ImageTurn | None

    def pixels(self, pixels: NDArray[np.floating]) -> Array:
        """Rectify pixels, in double precision.

        Parameters
        ----------
        pixels : ndarray, (n, 4)
            ``u_left, v_left, u_right, v_right``.

        Returns
        -------
        ndarray, (n, 4)
            With NaN where one would end behind its camera.
        """
        result = pixels.astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            for turn, columns in ((self.left, slice(0, 2)), (self.right, slice(2, 4))):
                if turn is not None:
                    result[:, columns] = np.column_stack(turn.moved(*result[:, columns].T))
        return result

    def frame(
        self,
        ids: NDArray[np.uint32],
        pixels: NDArray[np.float32],
        noise: NDArray[np.float32] | None = None,
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32] | None]:
        """Rectify a frame, ids (n,), pixels (n, 4) and their noise (n,) where it is stated.

        What no camera could have seen is left out.
        """
        result = self.pixels(pixels)
        kept = np.all(np.abs(result) <= LARGEST_PIXEL, axis=1)  # not NaN either
        stated = None if noise is None else noise[kept]
        return ids[kept], result[kept].astype(np.float32), stated


class RectifiedPair(NamedTuple):
    """What :func:`rectified_pair` makes of two cameras.

    Attributes
    ----------
    baseline : float
        Metres.
    R_left_rectified : ndarray, (3, 3), or None
        Axes of the rectified left camera in those of the left one; None where they are the same.
    pixels : PixelRectification or None
        None where all pixels are rectified already.
    """

    baseline: float
    R_left_rectified: Array | None
    pixels: PixelRectification | None

    @property
    def turns(self) -> bool:
        """Whether an image turns, and does not just get other intrinsics."""
        both = () if self.pixels is None else (self.pixels.left, self.pixels.right)
        return any(turn is not None and turn.R_after_before is not None for turn in both)


def rectified_pair(left: Intrinsics, right: Intrinsics, T_left_right: Array) -> RectifiedPair:
    """Rectify the pixels of a stereo pair without lens distortion.

    Parameters
    ----------
    left, right : Intrinsics
    T_left_right : ndarray, (4, 4)
        Pose of the right optical frame in the left one, metres.

    Raises
    ------
    NoStereoPairError
        Where they do not stand side by side, or look to different sides.
    """
    p = T_left_right[:3, 3]
    baseline = float(np.linalg.norm(p))
    R_left = _least_turn(p / baseline) if baseline > 0 else np.eye(3)
    R_right = R_left @ se3.nearest_rotation(T_left_right[:3, :3])
    if not (p[0] > _LEAST_COSINE * baseline and R_right[2, 2] > _LEAST_COSINE):
        place = np.array2string(p, precision=3, separator=", ", suppress_small=True)
        angle = np.degrees(np.linalg.norm(se3.log_rotation(R_right)))
        raise NoStereoPairError(
            f"the right camera lies at {place} m in the left one (x right, y down, z forward), "
            f"turned by {angle:.0f} degrees"
        )
    R_left_is_known = _moves_pixels(R_left, left)
    if not R_left_is_known:
        baseline, R_left, R_right = float(p[0]), np.eye(3), R_left.T @ R_right
    turns = [_turn(left, left, R_left), _turn(right, left, R_right)]
    return RectifiedPair(
        baseline,
        R_left.T if R_left_is_known else None,
        PixelRectification(*turns) if any(turns) else None,
    )


def _least_turn(direction: Array) -> Array:
    """Smallest rotation (3, 3) that turns a unit vector (3,) into the x axis."""
    axis = np.cross(direction, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(axis))
    if sine == 0.0:
        return np.eye(3)
    return se3.exp_rotation(axis / sine * np.arctan2(sine, direction[0]))


def _moves_pixels(R: Array, camera: Intrinsics) -> bool:
    angle = float(np.linalg.norm(se3.log_rotation(R)))
    return angle * max(camera.fx, camera.fy) > _SAME_PIXELS


def _turn(before: Intrinsics, after: Intrinsics, R: Array) -> ImageTurn | None:
    if _moves_pixels(R, before):
        return ImageTurn(before, after, tuple(R.ravel().tolist()))
    if max(abs(a - b) for a, b in zip(before, after, strict=True)) > _SAME_PIXELS:
        return ImageTurn(before, after)
    return None
