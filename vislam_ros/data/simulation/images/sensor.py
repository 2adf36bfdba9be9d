# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor makes of light: exposure, vignetting, noise and grey levels."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.simulation.images.texture import Field, Grey

Array = NDArray[np.float64]

# A small sensor's pixel holds about 10,000 electrons, and is read to about ten (EMVA 1288, eq. 2
# and 11: the variance of the photons' number is that number).
_ELECTRONS_A_GREY = 10_000 / 255
_READ_OUT_STD = 0.6  # grey
# Light that is missing in the corners.
_VIGNETTING = 0.2


class Sensor:
    """Turns radiance, in grey levels at exposure 1, to an image.

    Parameters
    ----------
    image_size : tuple of int, (2,)
    noise : float
        Times the noise of a small sensor; 0 for none.
    """

    def __init__(self, image_size: tuple[int, int], noise: float = 1.0) -> None:
        width, height = image_size
        x = np.linspace(-1, 1, width, dtype=np.float32)
        y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
        self._vignette: Field = 1 - np.float32(_VIGNETTING / 2) * (x * x + y * y)
        self._noise = noise

    def image(self, radiance: Grey | Field, exposure: float, rng: np.random.Generator) -> Grey:
        """Expose (height, width) once; what is too bright is white."""
        signal = radiance * (np.float32(exposure) * self._vignette)
        if self._noise > 0:
            std = np.sqrt(signal / np.float32(_ELECTRONS_A_GREY) + np.float32(_READ_OUT_STD**2))
            std *= rng.standard_normal(signal.shape, dtype=np.float32)
            signal += np.float32(self._noise) * std
        # Rounds, and keeps what is too bright white.
        return np.asarray(cv2.convertScaleAbs(np.maximum(signal, 0)), dtype=np.uint8)


def exposures(seconds: Array, rng: np.random.Generator) -> Array:
    """Exposure (n,) of each frame, with an automatic control that errs.

    It wanders by a tenth, steps a little now and then, and is twice too long for the twelfth part
    of the time, and later half as long as it should be.

    Parameters
    ----------
    seconds : ndarray, (n,)
        Of the frames, from 0 on.
    rng : Generator
    """
    duration = max(float(seconds[-1]), 1e-9)
    phase = rng.uniform(0, 2 * np.pi, 2)
    wander = 0.07 * np.sin(2 * np.pi * seconds / 7 + phase[0])
    wander += 0.03 * np.sin(2 * np.pi * seconds / 1.3 + phase[1])
    steps = rng.normal(0, 0.06, int(duration / 3) + 1)[(seconds / 3).astype(int)]
    share = seconds / duration
    too_long = 0.9 * ((share > 0.3) & (share < 0.38))
    too_short = -0.9 * ((share > 0.65) & (share < 0.73))
    return np.exp(wander + steps + too_long + too_short)
