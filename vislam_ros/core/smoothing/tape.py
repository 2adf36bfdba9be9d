# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tape of a filter: what it did to its error state, in order, for the backward pass.

The way back needs the covariance at every update, which is far too much to keep: 1 GB for the
3000 steps of a drive with 66 active landmarks. An operation itself is small (Jacobians and
residuals, some 15 to 50 kB a step), so the tape keeps the operations, and the covariance at a
checkpoint every 50th step only; the backward pass goes forward from there again, from one
checkpoint to the next. That costs the time of the filter's own updates once more, and no file.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.operations.error_state import Operation

Array = NDArray[np.float64]

# The covariances of all checkpoints and those between two weigh the same at about the root of the
# number of steps, which for a drive of some minutes is this.
_STEPS_BETWEEN_CHECKPOINTS = 50


@dataclass
class Checkpoint:
    """A covariance, and what was done to it until the next checkpoint.

    Attributes
    ----------
    covariance : ndarray, (D, D)
    operations : list of Operation
    """

    covariance: Array
    operations: list[Operation[Any]] = field(default_factory=list)


class Tape:
    """Records a filter's operations.

    Attributes
    ----------
    checkpoints : list of Checkpoint
    vehicle_size : int
        Size s of the error state's vehicle state.
    last : Operation or None
        What the way back begins with, after all that was recorded.
    """

    def __init__(self) -> None:
        self.checkpoints: list[Checkpoint] = []
        self.vehicle_size = 0
        self.last: Operation[Any] | None = None
        self._steps = 0

    def begin(self, vehicle_size: int, covariance: Array) -> None:
        """Take the covariance (s, s) of a filter before its first step."""
        self.vehicle_size = vehicle_size
        self.checkpoints.append(Checkpoint(covariance.copy()))

    def record(self, operation: Operation[Any]) -> None:
        """Record an operation."""
        self.checkpoints[-1].operations.append(operation.recorded())

    def end_step(self, covariance: Array, last: Operation[Any] | None = None) -> None:
        """Take the covariance (D, D) at the end of a step, and with what the way back begins."""
        self.last = last
        self._steps += 1
        if self._steps % _STEPS_BETWEEN_CHECKPOINTS == 0:
            self.checkpoints.append(Checkpoint(covariance.copy()))
