# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The error state of a filter over a vehicle and landmarks, and what an operation on it is.

The error state is ``[vehicle; delta_1; ...; delta_n]``: a vehicle state that begins with the pose
error ``[rho; theta]`` on the right, and three numbers for each active landmark (the report's
eq. 19-20 and 62-63, with the vehicle first). A filter keeps its estimate and its landmarks' names
itself; whatever happens to the covariance is an operation that it applies to the error state.
Where there is a tape, every operation is on it for the backward pass.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.linear_update import diagonal_blocks, downdate
from vislam_ros.core.linalg.scratch import Scratch

Array = NDArray[np.float64]
Result = TypeVar("Result")


class Operation(ABC, Generic[Result]):
    """A change of the error state. Its arrays are its own: nobody writes into them later."""

    @abstractmethod
    def forward(self, state: "ErrorState") -> Result:
        """Change the covariance; return what the filter and the backward pass need of it."""

    def recorded(self) -> "Operation[Result]":
        """Return what a tape keeps: all that the same change takes a second time."""
        return self


class Recorder(Protocol):
    """What an error state asks of a tape."""

    def begin(self, vehicle_size: int, covariance: Array) -> None:
        """Take the covariance (D, D) before the first step."""

    def record(self, operation: Operation[Any]) -> None:
        """Take an operation that has been applied."""

    def end_step(self, covariance: Array, last: Operation[Any] | None) -> None:
        """Take the covariance (D, D) at the end of a step, and with what the way back begins."""


class ErrorState:
    """The covariance of a filter's error state, the tape, and memory to work in.

    Parameters
    ----------
    covariance : ndarray, (s + 3 n, s + 3 n)
    vehicle_size : int
        Size s of the vehicle state.
    tape : Recorder, optional
        Where to record for the backward pass.
    scratch : Scratch, optional
        Where operations work; what they return may lie there.

    Attributes
    ----------
    vehicle_size : int
    scratch : Scratch
    """

    def __init__(
        self,
        covariance: Array,
        vehicle_size: int,
        tape: Recorder | None = None,
        scratch: Scratch | None = None,
    ):
        self.vehicle_size = vehicle_size
        self.scratch = scratch or Scratch()
        self._P = covariance.copy()
        self._downdate: Array | None = None
        self._tape = tape
        if tape is not None:
            tape.begin(self.vehicle_size, self._P)

    def apply(self, operation: Operation[Result]) -> Result:
        """Apply an operation and record it; one that raises is as if it had not been tried."""
        result = operation.forward(self)
        if self._tape is not None:
            self._tape.record(operation)
        return result

    def end_step(self, T_world_body: Array, last: Operation[Any] | None = None) -> None:
        """End a step at a pose (4, 4), which the backward pass is to smooth.

        Parameters
        ----------
        T_world_body : ndarray, (4, 4)
        last : Operation, optional
            Said of all the drive if this step is its last; it is not applied here.
        """
        self.apply(PoseMark(T_world_body))
        if self._tape is not None:
            self._tape.end_step(self.covariance, last)

    @property
    def covariance(self) -> Array:
        """The covariance P (s + 3 n, s + 3 n), no copy."""
        if self._downdate is not None:
            downdate(self._P, self._downdate.T)
            self._downdate = None
        return self._P

    @covariance.setter
    def covariance(self, P: Array) -> None:
        self._P = P

    def defer_downdate(self, Y: Array) -> None:
        """Let the covariance be ``P - Y^T Y`` for Y (r, D), to be worked out when it is needed."""
        self._P, self._downdate = self.covariance, Y

    def take_downdate(self) -> tuple[Array, Array]:
        """Return P and Y (r, D) of ``P - Y^T Y``, for who makes them one; r may be 0."""
        Y = self._downdate
        self._downdate = None
        return self._P, np.empty((0, len(self._P))) if Y is None else Y

    @property
    def is_recorded(self) -> bool:
        """Whether there is a tape."""
        return self._tape is not None

    @property
    def active(self) -> int:
        """Number n of landmarks."""
        return (len(self._P) - self.vehicle_size) // 3

    @property
    def vehicle_covariance(self) -> Array:
        """Covariance (s, s) of the vehicle state, no copy."""
        return self.covariance[: self.vehicle_size, : self.vehicle_size]

    def landmark_covariances(self) -> Array:
        """Covariances (n, 3, 3) of the landmarks, copies."""
        return diagonal_blocks(self.covariance[self.vehicle_size :, self.vehicle_size :], 3)

    def rows_of(self, slots: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows (m, 3) of the landmarks in some slots (m,)."""
        return self.vehicle_size + 3 * slots[:, None] + np.arange(3)


@dataclass(frozen=True)
class PoseMark(Operation[None]):
    """A pose to be smoothed: the error state stays as it is.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    """

    T_world_body: Array

    def forward(self, state: ErrorState) -> None:
        """Change nothing."""
