# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A member of a dataset's file as an array of finite numbers, and what to say where it is not."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.datasets.arrays.array_stream import Arrays
from vislam_ros.errors import VislamError


def finite(
    path: Path, arrays: Arrays, key: str, *, may_be_nan: bool = False
) -> NDArray[np.float64]:
    """Read a whole member; raises a VislamError that names the first value that is not finite."""
    values = arrays[key]().array()
    right = np.isfinite(values) | (may_be_nan & np.isnan(values))
    if not np.all(right):
        index = tuple(int(i) for i in np.argwhere(~right)[0])
        raise VislamError(
            f"{path}: {key}{list(index)} is {values[index]}: every value must be finite"
        )
    return values


def wrong_shape(path: Path, key: str, shape: tuple[int, ...], wanted: str) -> VislamError:
    """Error that tells which shape a member has and which is wanted."""
    return VislamError(f"{path}: {key} has shape {shape}, not {wanted}")
