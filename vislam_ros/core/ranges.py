# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What numbers of the world can be: beyond these a value is a fault, not a measurement.

They are far wider than anything that carries a camera, so ordinary data never meet them, and
narrow enough that no product of a few of them overflows. Whatever is read, from a file or from a
message, is held against this one table, and a refusal names the range that is meant.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vislam_ros.errors import VislamError


class Range(NamedTuple):
    """Values from ``low`` to ``high``, both included.

    Attributes
    ----------
    what : str
        For messages.
    low, high : float
    unit : str
    """

    what: str
    low: float
    high: float
    unit: str

    def complaint(self, values: ArrayLike) -> str | None:
        """Say which of some values is first outside the range, and what the range is; or None."""
        numbers = np.asarray(values, dtype=float)
        # Comparisons with NaN are false.
        outside = ~((numbers >= self.low) & (numbers <= self.high))
        if not outside.any():
            return None
        worst = float(numbers[outside].flat[0])
        return (
            f"{self.what} of {worst:g} {self.unit} cannot be: it is meant to be from "
            f"{self.low:g} to {self.high:g}"
        )

    def require(self, values: ArrayLike, where: str) -> None:
        """Raise a VislamError that begins with ``where`` if a value lies outside."""
        if complaint := self.complaint(values):
            raise VislamError(f"{where}: {complaint}")


#: Distances on Earth end at 2e7 m, those of odometry far below.
LARGEST_POSITION = 1e9
#: No camera has pixels beyond.
LARGEST_PIXEL = 1e6

#: A rifle's bullet flies at 1e3 m/s.
VELOCITY = Range("a velocity", -1e3, 1e3, "m/s")
#: 160 turns in a second; gyroscopes end at 70 rad/s.
TURN_RATE = Range("an angular velocity", -1e3, 1e3, "rad/s")
#: A shell's in its barrel; accelerometers end at 4e3 m/s^2.
SPECIFIC_FORCE = Range("a specific force", -1e6, 1e6, "m/s^2")
POSITION = Range("a coordinate", -LARGEST_POSITION, LARGEST_POSITION, "m")
#: Of a camera in its vehicle; ships have 4e2 m.
MOUNT = Range("a camera's place in the body", -1e3, 1e3, "m")
#: Of an image a pixel wide to that of a telescope.
FOCAL_LENGTH = Range("a focal length", 1.0, LARGEST_PIXEL, "px")
PRINCIPAL_POINT = Range("a principal point", -LARGEST_PIXEL, LARGEST_PIXEL, "px")
#: From a stereo microscope's to a ship's.
BASELINE = Range("a baseline", 1e-4, 1e3, "m")
PIXEL = Range("a pixel", -LARGEST_PIXEL, LARGEST_PIXEL, "px")
#: A hundredth of what Lucas and Kanade reach, to an image's width.
PIXEL_NOISE = Range("a pixel's noise", 1e-4, 1e4, "px")
#: Of a camera of 2000 Hz to one picture a minute; stamps in another unit are beyond.
PERIOD = Range("a time between images", 5e-4, 60.0, "s")
#: What goes on after a day is another drive.
GAP = Range("a gap between stamps", 0.0, 86_400.0, "s")
