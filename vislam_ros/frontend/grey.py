# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Grey images of eight bits, of what cameras give, by the names of ROS's encodings."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.errors import VislamError

Grey = NDArray[np.uint8]

# OpenCV names a Bayer pattern by its second row and column, ROS by its first.
_CONVERSIONS = {
    "mono": None,
    "rgb": cv2.COLOR_RGB2GRAY,
    "bgr": cv2.COLOR_BGR2GRAY,
    "rgba": cv2.COLOR_RGBA2GRAY,
    "bgra": cv2.COLOR_BGRA2GRAY,
    "bayer_rggb": cv2.COLOR_BayerBG2GRAY,
    "bayer_bggr": cv2.COLOR_BayerRG2GRAY,
    "bayer_gbrg": cv2.COLOR_BayerGR2GRAY,
    "bayer_grbg": cv2.COLOR_BayerGB2GRAY,
}
# OpenCV's own names for the same.
_SYNONYMS = {"8UC1": "mono8", "16UC1": "mono16", "8UC3": "bgr8", "8UC4": "bgra8"}
_CHANNELS = {"rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}

#: Encodings that can be read.
ENCODINGS = (*(f"{name}{bits}" for name in _CONVERSIONS for bits in (8, 16)), *_SYNONYMS)

# Share of the pixels that may lie outside of the range on either side [%]: specks of light.
_OUTSIDE = 0.5


def grey(image: NDArray[Any], encoding: str, limits: tuple[float, float] = (0, 65535)) -> Grey:
    """Turn an image into grey.

    Parameters
    ----------
    image : ndarray of uint8 or uint16, (H, W) or (H, W, channels)
    encoding : str
        One of :data:`ENCODINGS`.
    limits : tuple of float, (2,)
        Values of a 16-bit image that become 0 and 255. Keep them over a stream, or use
        :class:`GreyStream`.

    Returns
    -------
    ndarray of uint8, (H, W)
        The very image where it is of eight bits and grey.

    Raises
    ------
    VislamError
        If the encoding is not known, or the image does not have its shape or type.
    """
    plain = _intensity(image, encoding)
    if plain.dtype == np.uint8:
        return plain
    low, high = limits
    scaled = (plain.astype(np.float32) - low) * (255 / max(high - low, 1.0))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


class GreyStream:
    """Turns the images of one camera into grey, and scales those of 16 bits all alike.

    Cameras use 10, 12, 14 or all of the 16 bits, and thermal ones a small part in the middle. The
    range is that of the first image, with room to spare, and only ever grows: so the scale
    changes a few times in a stream's life, and does not follow what is seen.
    """

    def __init__(self) -> None:
        self._limits: tuple[float, float] | None = None

    def grey(self, image: NDArray[Any], encoding: str) -> Grey:
        """Turn the next image into grey, as :func:`grey` does."""
        plain = _intensity(image, encoding)
        if plain.dtype == np.uint8:
            return plain
        low, high = np.percentile(plain[::4, ::4], (_OUTSIDE, 100 - _OUTSIDE))
        # Room for what the next images show.
        room = (high - low) / 2
        if self._limits is None:
            self._limits = max(low - room, 0.0), min(high + room, 65535.0)
        elif low < self._limits[0] or high > self._limits[1]:
            first, last = self._limits
            first = max(low - room, 0.0) if low < first else first
            last = min(high + room, 65535.0) if high > last else last
            self._limits = first, last
        return grey(plain, "mono16", self._limits)


def _intensity(image: NDArray[Any], encoding: str) -> NDArray[Any]:
    """Grey values (H, W) of 8 or 16 bits."""
    name = _SYNONYMS.get(encoding, encoding).lower()
    kind, bits = (name[:-1], 8) if name.endswith("8") else (name[:-2], 16)
    if not name.endswith(("8", "16")) or kind not in _CONVERSIONS:
        known = ", ".join(ENCODINGS)
        raise VislamError(f"image encoding {encoding!r}: is not known; use one of {known}")
    channels = _CHANNELS.get(kind)
    wanted = image.ndim == 2 if channels is None else image.shape[2:] == (channels,)
    if not wanted or image.dtype != np.dtype(f"uint{bits}") or 0 in image.shape:
        shape = "(H, W)" if channels is None else f"(H, W, {channels})"
        raise VislamError(
            f"image: is {image.shape} of {image.dtype}, but {encoding} is {shape} of uint{bits}"
        )
    conversion = _CONVERSIONS[kind]
    if conversion is None:
        return image
    if kind.startswith("bayer") and min(image.shape) < 3:
        raise VislamError(f"image: is {image.shape}, too small for {encoding}")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion))
