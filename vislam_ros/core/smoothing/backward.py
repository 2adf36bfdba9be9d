# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The backward pass (modified Bryson-Frazier): the exact final map and smoothed poses.

A landmark that has left the error state is still moved by what the filter over all landmarks
learns later, through its cross-covariance C with those that stayed. The adjoints lambda and
Lambda sum up all that was learned after an operation, so ``m + C lambda`` and ``P_mm - C Lambda
C^T`` are that filter's last words on the landmark. A pose is smoothed as if it had left at its
step.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.scratch import FreshMemory
from vislam_ros.core.operations.correction import Correction, VehicleCorrection
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState, Operation, PoseMark
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization
from vislam_ros.core.operations.transition import (
    NewBeginning,
    RandomWalk,
    Transition,
    VehicleTransition,
)
from vislam_ros.core.smoothing.adjoint import Adjoint, Backward
from vislam_ros.core.smoothing.correction_adjoints import (
    CorrectionAdjoint,
    DirectCorrectionAdjoint,
    VehicleCorrectionAdjoint,
)
from vislam_ros.core.smoothing.operation_adjoints import (
    InitializationAdjoint,
    MarginalizationAdjoint,
    NewBeginningAdjoint,
    PoseMarkAdjoint,
    RandomWalkAdjoint,
    TransitionAdjoint,
    VehicleTransitionAdjoint,
)
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.core.tracking.tracked_frame import Keys

Array = NDArray[np.float64]

_ADJOINTS: dict[type[Operation[Any]], Callable[[Any, ErrorState], Backward]] = {
    RandomWalk: RandomWalkAdjoint,
    VehicleTransition: VehicleTransitionAdjoint,
    NewBeginning: NewBeginningAdjoint,
    Transition: TransitionAdjoint,
    Correction: CorrectionAdjoint,
    VehicleCorrection: VehicleCorrectionAdjoint,
    DirectCorrection: DirectCorrectionAdjoint,
    Initialization: InitializationAdjoint,
    Marginalization: MarginalizationAdjoint,
    PoseMark: PoseMarkAdjoint,
}


@dataclass(frozen=True)
class Smoothed:
    """What a drive's end knows of its whole course.

    Attributes
    ----------
    poses : ndarray, (T, 4, 4)
        Smoothed poses of the body in the world, one for each mark on the tape.
    pose_covariances : ndarray, (T, 6, 6)
        Of the pose errors ``[rho; theta]`` on the right.
    keys : ndarray of int64, (M,)
        The landmarks that were marginalized, in that order.
    positions : ndarray, (M, 3)
        Metres.
    covariances : ndarray, (M, 3, 3)
        Square metres.
    """

    poses: Array
    pose_covariances: Array
    keys: Keys
    positions: Array
    covariances: Array


def smooth(tape: Tape) -> Smoothed:
    """Go back over a tape, which stays as it is, from its end to its beginning."""
    poses: list[tuple[Array, Array]] = []
    landmarks: list[tuple[Keys, Array, Array]] = []
    adjoint: Adjoint | None = None
    for checkpoint in reversed(tape.checkpoints):
        state = ErrorState(checkpoint.covariance, tape.vehicle_size, scratch=FreshMemory())
        operations = checkpoint.operations
        if adjoint is None and tape.last is not None:
            operations = [*operations, tape.last]
        steps = [_ADJOINTS[type(operation)](operation, state) for operation in operations]
        if adjoint is None:
            adjoint = Adjoint.zero(len(state.covariance))
        for step in reversed(steps):
            if isinstance(step, PoseMarkAdjoint):
                poses.append(step.smoothed(adjoint))
            elif isinstance(step, MarginalizationAdjoint):
                landmarks.append((step.keys, *step.final(adjoint)))
            adjoint = step.backward(adjoint)
    poses.reverse()
    landmarks.reverse()
    return Smoothed(
        poses=np.array([pose for pose, _ in poses]).reshape(-1, 4, 4),
        pose_covariances=np.array([covariance for _, covariance in poses]).reshape(-1, 6, 6),
        keys=np.concatenate([np.empty(0, dtype=np.int64), *(keys for keys, _, _ in landmarks)]),
        positions=np.concatenate([np.empty((0, 3)), *(means for _, means, _ in landmarks)]),
        covariances=np.concatenate([np.empty((0, 3, 3)), *(P for _, _, P in landmarks)]),
    )
