# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Laying an estimate onto its reference, and whether there is one way only to do it."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

AlignmentKind: TypeAlias = Literal["se3", "yaw", "none"]
"""What an alignment may do: any rigid motion, a turn about the vertical and a shift, nothing."""

ALIGNMENTS: tuple[AlignmentKind, ...] = get_args(AlignmentKind)


@dataclass(frozen=True)
class Alignment:
    """How an estimate was laid onto its reference.

    Attributes
    ----------
    T_reference_estimate : ndarray, (4, 4)
        Takes positions of the estimate to where the reference has them.
    residual : ndarray, (n, 3)
        Aligned positions less the reference's, metres.
    ambiguity : str or None
        Why another motion would fit as well, where one does.
    """

    T_reference_estimate: Array
    residual: Array
    ambiguity: str | None


def align_positions(source: Array, target: Array, kind: AlignmentKind = "se3") -> Alignment:
    """Lay the positions of an estimate (n, 3) onto those of its reference (n, 3).

    Raises
    ------
    VislamError
        Where ``kind`` is none of :data:`ALIGNMENTS`.
    """
    if kind == "se3":
        T = alignment(source, target)
    elif kind == "yaw":
        T = yaw_alignment(source, target)
    elif kind == "none":
        T = np.eye(4)
    else:
        raise VislamError(f"align is {kind!r}: choose one of {', '.join(ALIGNMENTS)}")
    residual = source @ T[:3, :3].T + T[:3, 3] - target
    return Alignment(T, residual, _ambiguity(target, residual, kind))


def alignment(source: Array, target: Array) -> Array:
    """Rigid motion that brings points nearest to their targets in the least-squares sense.

    Umeyama, *Least-squares estimation of transformation parameters between two point patterns*
    (1991), eq. 40 and 41, without scale.

    Parameters
    ----------
    source, target : ndarray, (n, 3)

    Returns
    -------
    ndarray, (4, 4)
        ``T`` with ``T source`` nearest to ``target``. About the line of points that all lie on
        one, its angle is arbitrary.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    R = se3.nearest_rotation((target - target_mean).T @ (source - source_mean))
    return _motion(R, source_mean, target_mean)


def best_scale(source: Array, target: Array) -> float | None:
    """By how much an aligned path is to be stretched to fit best: Umeyama's eq. 42.

    Parameters
    ----------
    source, target : ndarray, (n, 3)

    Returns
    -------
    float or None
        1 where both are in the same metres; None where the source is a single point.
    """
    R = alignment(source, target)[:3, :3]
    source, target = source - source.mean(axis=0), target - target.mean(axis=0)
    extent = float(np.sum(source**2))
    return float(np.sum(target * (source @ R.T))) / extent if extent > 0 else None


def yaw_alignment(source: Array, target: Array) -> Array:
    """The same among turns about z with a shift.

    What an estimator with gravity cannot know of its frame: Zhang and Scaramuzza, *A Tutorial on
    Quantitative Trajectory Evaluation for Visual(-Inertial) Odometry* (2018).

    Parameters
    ----------
    source, target : ndarray, (n, 3)
        In frames whose z is up.

    Returns
    -------
    ndarray, (4, 4)
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    # The angle maximizes the sum of target . R source: a sum of cosines about its own phase.
    products = (target - target_mean)[:, :2].T @ (source - source_mean)[:, :2]
    angle = np.arctan2(products[1, 0] - products[0, 1], products[0, 0] + products[1, 1])
    return _motion(se3.exp_rotation([0.0, 0.0, angle]), source_mean, target_mean)


def first_pose_alignment(reference: Trajectory, estimate: Trajectory) -> Array:
    """Motion (4, 4) that lays the reference's first pose in common onto the estimate's."""
    i, j = associate(reference, estimate)
    T_reference, T_estimate = reference.T_world_body[i[0]], estimate.T_world_body[j[0]]
    return T_estimate @ se3.inverse(T_reference)


def _motion(R: Array, source_mean: Array, target_mean: Array) -> Array:
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = target_mean - R @ source_mean
    return T


def _ambiguity(target: Array, residual: Array, kind: AlignmentKind) -> str | None:
    """Why the turn is arbitrary: the path is no wider than its own errors where it must be."""
    if kind == "none":
        return None
    points = target - target.mean(axis=0)
    if kind == "yaw":
        points = points[:, :2]
    # Root mean squares along the principal axes, the largest first.
    widths = np.linalg.svd(points, compute_uv=False) / np.sqrt(len(points))
    errors = float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
    rounding = float(np.finfo(float).eps * np.abs(target).max() * len(target))
    told = max(errors, rounding)
    if widths[0] <= told:
        return (
            f"the alignment is not unique: the path extends {widths[0]:.2g} m, its errors "
            f"{errors:.2g} m (root mean squares): any turn fits as well"
        )
    if kind == "se3" and widths[1] <= told:
        return (
            f"the alignment is not unique: the path leaves a straight line by {widths[1]:.2g} m, "
            f"its errors are {errors:.2g} m (root mean squares): any turn about the line fits as "
            "well; of turns about the vertical only one does: align by yaw"
        )
    return None
