# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tape of a filter: what it did to its error state, in order, for the backward pass.

The way back needs the covariance at every update, which is far too much to keep: 1 GB for the
3000 steps of a drive with 66 active landmarks. An operation itself is small (Jacobians and
residuals, some 15 to 50 kB a step), so the tape keeps the operations and the covariance at every
50th step only; the backward pass carries it forward again from there, one stretch at a time. That
costs the time of the filter's own updates once more, and no file.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.smoothing.error_operations import Operation

Array = NDArray[np.float64]

# The covariances of all stretches' beginnings and those of one stretch weigh the same at about
# the root of the number of steps, which for a drive of some minutes is this.
_STEPS_IN_A_STRETCH = 50


@dataclass
class Stretch:
    """Some steps of a drive.

    Attributes
    ----------
    covariance : ndarray, (D, D)
        At the beginning.
    operations : list of Operation
    """

    covariance: Array
    operations: list[Operation] = field(default_factory=list)


class Tape:
    """Records a filter's operations.

    Parameters
    ----------
    small_size : int
        Size s of the error state's small part.

    Attributes
    ----------
    small_size : int
    stretches : list of Stretch
    """

    def __init__(self, small_size: int):
        self.small_size = small_size
        self.stretches: list[Stretch] = []
        self._steps = 0

    def begin_step(self, covariance: Array) -> None:
        """Tell that a step begins, with the covariance (D, D) as it stands."""
        if self._steps % _STEPS_IN_A_STRETCH == 0:
            self.stretches.append(Stretch(covariance.copy()))
        self._steps += 1

    def record(self, operation: Operation) -> None:
        """Record an operation. Its arrays are copied: filters reuse theirs."""
        copies: dict[str, Any] = {
            item.name: np.array(value)
            for item in dataclasses.fields(operation)
            if (value := getattr(operation, item.name)) is not None
        }
        self.stretches[-1].operations.append(dataclasses.replace(operation, **copies))
