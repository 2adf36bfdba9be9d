# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The noise that the tracker states for what it gives."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

# What is in no fit: neighbouring pixels share their errors, surfaces are no planes, lenses are
# not quite as calibrated. Standard deviations, and a factor on those of the fit: see stated_noise.
_FLOOR, _FACTOR = 0.03, 1.5


def stated_noise(left: Floats, right: Floats, drift: Floats) -> Floats:
    """Standard deviation (n,) of the pixels of observations.

    Parameters
    ----------
    left, right : ndarray, (n, 3)
        Covariances of the two fits: of x, of x and y, of y [px^2].
    drift : ndarray, (n,)
        Variances of the patches' places [px^2].
    """
    fit = (left[:, 0] + left[:, 2] + right[:, 0] + right[:, 2]) / 2
    return np.sqrt(_FLOOR**2 + _FACTOR**2 * fit + drift).astype(np.float32)
