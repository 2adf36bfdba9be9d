# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images from messages, for the message classes of rclpy and of rosbags alike."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage

# Channels and bytes of each, by the encodings of sensor_msgs/image_encodings.hpp that hold pixels.
_COLOURS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_LAYOUTS = {
    **{f"{colour}{8 * size}": (n, size) for colour, n in _COLOURS.items() for size in (1, 2)},
    **{
        f"bayer_{order}{8 * size}": (1, size)
        for order in ("rggb", "bggr", "gbrg", "grbg")
        for size in (1, 2)
    },
    **{f"8UC{n}": (n, 1) for n in (1, 3, 4)},
    **{f"16UC{n}": (n, 2) for n in (1, 3, 4)},
}
_SAME_AS = {
    "8UC1": "mono8",
    "8UC3": "bgr8",
    "8UC4": "bgra8",
    "16UC1": "mono16",
    "16UC3": "bgr16",
    "16UC4": "bgra16",
    "y8": "mono8",
    "y16": "mono16",
}


def image(message: Any) -> tuple[NDArray[Any], str]:
    """Pixels (H, W) or (H, W, channels), in the machine's byte order, and encoding of an Image.

    Raises
    ------
    RefusedMessage
        Where the encoding is none of 8 or 16 bits, or the data have another size than they say.
    """
    given = str(message.encoding)
    encoding = _SAME_AS.get(given, given)
    if encoding not in _LAYOUTS:
        raise RefusedMessage(
            Refusal.BAD_FIELDS,
            f"encoding is {given!r:.40}: publish mono8, or another of 8 or 16 bits",
        )
    channels, size = _LAYOUTS[encoding]
    width, height, step = int(message.width), int(message.height), int(message.step)
    row = width * channels * size
    data = np.frombuffer(message.data, dtype=np.uint8)
    if not width or not height or step < row or len(data) != height * step:
        raise RefusedMessage(
            Refusal.WRONG_SIZE, "data has another length than height, width and step say"
        )
    order = ">" if message.is_bigendian else "<"
    # A copy, for a message's bytes cannot be written to, nor do compiled functions take them.
    rows = np.array(data.reshape(height, step)[:, :row], order="C")
    pixels = rows.view(f"{order}u{size}")
    pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
    shape = (height, width) if channels == 1 else (height, width, channels)
    return pixels.reshape(shape), encoding
