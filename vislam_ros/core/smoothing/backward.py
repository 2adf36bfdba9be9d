# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The backward pass (modified Bryson-Frazier): the exact final map and smoothed poses.

A landmark that has left the error state is still moved by what the filter over all landmarks
learns later, through its cross-covariance C with those that stayed. The adjoints lambda and
Lambda sum up all that was learned after an operation, so ``m + C lambda`` and ``P_mm - C Lambda
C^T`` are that filter's last words on the landmark. A pose is smoothed as if it had left at its
step.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.linalg.linear_update import Scratch
from vislam_ros.core.smoothing.error_operations import Adjoint, Kept, PoseMark, Retirement
from vislam_ros.core.smoothing.tape import Stretch, Tape
from vislam_ros.core.tracking.tracked_frame import Keys

Array = NDArray[np.float64]


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
        The landmarks that were set aside, in that order.
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
    s = tape.small_size
    poses: list[tuple[Array, Array]] = []
    landmarks: list[tuple[Keys, Array, Array]] = []
    adjoint: Adjoint | None = None
    scratch = Scratch()
    for stretch in reversed(tape.stretches):
        P, kept_of = _carried(stretch, s, scratch)
        if adjoint is None:
            adjoint = Adjoint(np.zeros(len(P)), np.zeros_like(P))
        for operation in reversed(stretch.operations):
            kept = kept_of.pop()
            if isinstance(operation, PoseMark):
                poses.append(operation.smoothed(adjoint, kept))
            elif isinstance(operation, Retirement):
                landmarks.append((operation.keys, *operation.final(adjoint, kept)))
            adjoint = operation.pull_back(adjoint, kept, s)
    poses.reverse()
    landmarks.reverse()
    return Smoothed(
        poses=np.array([pose for pose, _ in poses]).reshape(-1, 4, 4),
        pose_covariances=np.array([covariance for _, covariance in poses]).reshape(-1, 6, 6),
        keys=np.concatenate([np.empty(0, dtype=np.int64), *(keys for keys, _, _ in landmarks)]),
        positions=np.concatenate([np.empty((0, 3)), *(means for _, means, _ in landmarks)]),
        covariances=np.concatenate([np.empty((0, 3, 3)), *(P for _, _, P in landmarks)]),
    )


def _carried(stretch: Stretch, s: int, scratch: Scratch) -> tuple[Array, list[Kept]]:
    """Carry the covariance over a stretch; return its end and what each operation keeps."""
    P = stretch.covariance.copy()
    kept_of = []
    for operation in stretch.operations:
        P, kept = operation.carry(P, s, scratch)
        kept_of.append(kept)
    return P, kept_of
