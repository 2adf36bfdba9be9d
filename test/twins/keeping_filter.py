# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A filter that keeps all that has left its error state, to measure the backward pass by."""

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.operations.correction import Correction, VehicleCorrection
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import Operation, PoseMark
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization
from vislam_ros.core.operations.transition import (
    NewBeginning,
    RandomWalk,
    Transition,
    VehicleTransition,
)
from vislam_ros.core.smoothing.backward import Smoothed

Array = NDArray[np.float64]


class KeepingFilter:
    """Applies operations to a covariance in which all that has left, or was marked, stays behind.

    It reads the operations' fields and uses none of their methods but what gives positions.

    Parameters
    ----------
    P : ndarray, (s, s)
        Covariance of the vehicle state.
    """

    def __init__(self, P: Array):
        self.s = self.size = len(P)
        self.P = P
        self.kept: list[tuple[Operation[Any], Array]] = []
        """Each marginalization or mark, and the estimates of what it keeps."""

    def apply(self, operation: Operation[Any]) -> None:
        if isinstance(operation, RandomWalk):
            self.P[: self.s, : self.s] += operation.noise
        elif isinstance(operation, NewBeginning):
            F = np.eye(len(self.P))
            F[operation.part] = 0.0
            self.P = F @ self.P @ F.T
        elif isinstance(operation, Transition | VehicleTransition):
            F = self.transition_matrix(operation)
            self.P = F @ self.P @ F.T
        elif isinstance(operation, Correction):
            n, r = operation.residual.shape
            H = np.zeros((n, r, len(self.P)))
            H[:, :, : self.s] = operation.H_vehicle
            for i, slot in enumerate(operation.slots):
                H[i, :, self.own(slot)] = operation.H_landmark[i]
            R = scipy.linalg.block_diag(*[operation.noise] * n)
            self.update(H.reshape(n * r, -1), R, operation.residual.ravel())
        elif isinstance(operation, VehicleCorrection):
            H = np.zeros((len(operation.H), len(self.P)))
            H[:, : self.s] = operation.H
            self.update(H, np.diag(operation.noise), operation.residual)
        elif isinstance(operation, DirectCorrection):
            rows = (self.s + 3 * operation.slots[:, None] + operation.components).ravel()
            R = np.diag(operation.noise.ravel())
            self.update(np.eye(len(self.P))[rows], R, operation.residual.ravel())
        elif isinstance(operation, Initialization):
            self.initialize(operation)
        elif isinstance(operation, Marginalization):
            self.marginalize(operation)
        else:
            self.keep(operation, np.eye(6, len(self.P)), np.zeros(6))

    def own(self, slot: int) -> slice:
        """Rows of the landmark in a slot."""
        return slice(self.s + 3 * slot, self.s + 3 * slot + 3)

    def transition_matrix(self, operation: Transition | VehicleTransition) -> Array:
        F, s = np.eye(len(self.P)), self.s
        F[:s, :s] = operation.vehicle
        if isinstance(operation, Transition):
            for slot, (D, C) in enumerate(
                zip(operation.landmarks, operation.coupling, strict=True)
            ):
                F[self.own(slot), self.own(slot)] = D
                F[self.own(slot), 6:s] = C
        return F

    def update(self, H: Array, R: Array, residual: Array) -> None:
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        shift = K @ residual
        self.P = self.P - K @ H @ self.P
        place = self.size
        for _, estimate in self.kept:
            estimate += shift[place : place + len(estimate)]
            place += len(estimate)

    def initialize(self, operation: Initialization) -> None:
        D, total, m = self.size, len(self.P), 3 * len(operation.noise)
        grow = np.zeros((total + m, total))
        grow[:D, :D] = np.eye(D)
        grow[D + m :, D:] = np.eye(total - D)
        if operation.J is not None:
            grow[D : D + m, : self.s] = operation.J.reshape(m, self.s)
        self.P = grow @ self.P @ grow.T
        self.P[D : D + m, D : D + m] += scipy.linalg.block_diag(*operation.noise)
        self.size += m

    def marginalize(self, operation: Marginalization) -> None:
        means, J_vehicle, J_landmark = operation.positions()
        J = np.zeros((len(means), 3, len(self.P)))
        for i, slot in enumerate(np.flatnonzero(operation.gone).tolist()):
            J[i, :, self.own(slot)] = np.eye(3) if J_landmark is None else J_landmark[i]
        if J_vehicle is not None:
            J[:, :, : self.s] = J_vehicle
        self.keep(operation, J.reshape(-1, len(self.P)), means.ravel())
        stays = np.ones(len(self.P), dtype=bool)
        stays[self.s : self.size] = np.repeat(~operation.gone, 3)
        self.P = self.P[np.ix_(stays, stays)]
        self.size -= int(np.sum(~stays))

    def keep(self, operation: Operation[Any], J: Array, estimate: Array) -> None:
        grow = np.vstack([np.eye(len(self.P)), J])
        self.P = grow @ self.P @ grow.T
        self.kept.append((operation, estimate.copy()))

    def smoothed(self) -> Smoothed:
        landmarks, marks = [], []
        place = self.size
        for operation, estimate in self.kept:
            own = slice(place, place + len(estimate))
            if isinstance(operation, PoseMark):
                marks.append((operation.T_world_body @ se3.exp(estimate), self.P[own, own]))
            elif isinstance(operation, Marginalization):
                for i, key in enumerate(operation.keys):
                    part = slice(place + 3 * i, place + 3 * i + 3)
                    landmarks.append((key, estimate[3 * i : 3 * i + 3], self.P[part, part]))
            place = own.stop
        return Smoothed(
            *(np.array(parts) for parts in zip(*marks, strict=True)),
            *(np.array(parts) for parts in zip(*landmarks, strict=True)),
        )
