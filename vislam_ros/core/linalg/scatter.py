# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks put into places of a matrix: numpy's own indices take several times as long."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled

Array = NDArray[np.float64]


@compiled("void(float64[:, ::1], int64[::1], int64[::1], float64[:, ::1])")
def put(block: Array, rows: NDArray[np.int64], columns: NDArray[np.int64], into: Array) -> None:
    """Copy a block (k, m) into some rows (k,) and columns (m,) of a matrix."""
    for i in range(len(rows)):
        for j in range(len(columns)):
            into[rows[i], columns[j]] = block[i, j]


@compiled("void(float64[:, ::1], int64[::1], int64[::1], float64[:, ::1])")
def put_both(
    block: Array, rows: NDArray[np.int64], columns: NDArray[np.int64], into: Array
) -> None:
    """Copy a block (k, m) into a symmetric matrix, and transposed across its diagonal."""
    for i in range(len(rows)):
        for j in range(len(columns)):
            into[rows[i], columns[j]] = block[i, j]
            into[columns[j], rows[i]] = block[i, j]
