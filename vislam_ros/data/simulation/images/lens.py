# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A raw camera: what an ideal one draws, through a lens."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.stereo_rig import RawCamera
from vislam_ros.data.simulation.images.drawing import Pinhole
from vislam_ros.data.simulation.images.surfaces import SurfaceStack
from vislam_ros.data.simulation.images.texture import Grey

Array = NDArray[np.float64]

# Of the solution for the ideal point behind a distorted pixel.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
_LEAST_OVERSAMPLING = 1.5
# How a point is spread by a sharp lens and the width of a pixel, standard deviation, pixels. What
# is sharper than half a pixel stands at another place in each image that samples it.
_POINT_SPREAD = 0.5


class LensView:
    """Draws the raw images of a camera.

    An ideal camera draws a field that holds all that the lens sees, in small pixels, and each raw
    pixel takes a mean of those around the point that its centre sees.

    Parameters
    ----------
    camera : RawCamera
        Without distortion, or with ``plumb_bob``.
    """

    def __init__(self, camera: RawCamera) -> None:
        width, height = camera.image_size
        x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        raw = np.stack([x.ravel(), y.ravel()], axis=1)
        ideal = ideal_pixels(camera, raw) if len(camera.D) else raw
        lowest = np.floor(ideal.min(axis=0)) - 1
        size = np.ceil(ideal.max(axis=0)) + 2 - lowest
        K = camera.K.copy()
        K[:2, 2] -= lowest
        # Four small pixels for each raw one, in all: where a lens shows its field unevenly, its
        # corners have more of them than its middle.
        factor = max(2 * math.sqrt(width * height / (size[0] * size[1])), _LEAST_OVERSAMPLING)
        self._pinhole = Pinhole(K, (int(size[0]), int(size[1])), factor)
        small = (ideal - lowest + 0.5) * factor - 0.5
        maps = small.T.reshape(2, height, width).astype(np.float32)
        # In fixed point a pixel is placed to 1/32 of a small one, and found twice as fast.
        self._maps = cv2.convertMaps(maps[0], maps[1], cv2.CV_16SC2)

    def draw(self, T_world_camera: Array, surfaces: SurfaceStack, empty: int = 0) -> Grey:
        """Draw the raw image (height, width) without noise; see :meth:`Pinhole.draw`."""
        small = self._pinhole.draw(T_world_camera, surfaces, empty)
        spread = _POINT_SPREAD * self._pinhole.oversampling
        picture = cv2.remap(
            cv2.GaussianBlur(small, (0, 0), spread, borderType=cv2.BORDER_REPLICATE),
            self._maps[0],
            self._maps[1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(picture, dtype=np.uint8)


def ideal_pixels(camera: RawCamera, raw: Array) -> Array:
    """Where a lens without distortion would show raw pixels (n, 2)."""
    points = cv2.undistortPoints(raw[:, None], camera.K, camera.D, P=camera.K, criteria=_CRITERIA)
    return np.asarray(points, dtype=np.float64)[:, 0]
