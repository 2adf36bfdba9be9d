# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The inverse of a matrix of two or three rows, for compiled functions: LAPACK takes longer."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Array = NDArray[np.float64]


@compiled("Tuple((float64[:, ::1], float64))(float64[:, :])")
def small_inverse(S: Array) -> tuple[Array, float]:
    """Inverse (r, r) and determinant of a positive matrix, by Gauss and Jordan."""
    r = len(S)
    inverse, determinant = S.copy(), 1.0
    for k in range(r):
        determinant *= inverse[k, k]
        pivot = 1.0 / inverse[k, k]
        inverse[k, k] = 1.0
        for j in range(r):
            inverse[k, j] *= pivot
        for i in range(r):
            if i != k:
                factor = inverse[i, k]
                inverse[i, k] = 0.0
                for j in range(r):
                    inverse[i, j] -= factor * inverse[k, j]
    return inverse, determinant
