# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The noise that the tracker states for what it gives.

A least-squares fit tells the covariance of its result by its residuals and gradients: a sharp
corner under a quiet sensor is placed better than a faint one, and one whose patch fits badly is
placed worse. Against exact truth and on real images errors go along with it, see
``tools/bench.py --only frontend``; what is in no fit is a floor, and a factor that neighbouring
pixels share their errors.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

# Standard deviation under which no observation is [px], and factor on that of the fit.
_FLOOR, _FACTOR = 0.04, 1.2


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
    return np.sqrt(_FLOOR**2 + _FACTOR**2 * (fit + drift)).astype(np.float32)
