# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the images before and after a step of a drive have in common."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import image_points_of
from vislam_ros.data.drive import Drive

Array = NDArray[np.float64]

_STEPS_LOOKED_AT = 240  # about 200 once frozen ones are left out
_MIN_DISPARITY = 2.0  # pixels
# Steps of which more pairs than this share repeat their pixels are frozen, or the car stands.
_FROZEN_SHARE = 0.5


@dataclass(frozen=True)
class StepPairs:
    """Landmarks seen at both ends of a step.

    Attributes
    ----------
    steps : ndarray of int64, (n,)
        ``k`` of the step from ``k`` to ``k + 1``.
    y : ndarray, (n, 3)
        ``(u_left, u_right, v)`` at ``k``, pixels.
    left : ndarray, (n, 2)
        ``u_left, v_left`` at ``k + 1``, pixels.
    """

    steps: NDArray[np.int64]
    y: Array
    left: Array


def step_pairs(drive: Drive, looked_at: NDArray[np.int64] | None = None) -> StepPairs:
    """Collect the common landmarks of steps that are not frozen.

    Parameters
    ----------
    drive : Drive
    looked_at : ndarray of int64, optional
        ``k`` of the steps, by default some that are evenly spaced.
    """
    if looked_at is None:
        looked_at = np.unique(np.linspace(0, drive.steps - 2, _STEPS_LOOKED_AT).astype(int))
    looked_at = looked_at[(looked_at >= 0) & (looked_at < drive.steps - 1)]
    steps, y, left = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))], [np.empty((0, 2))]
    for k in looked_at.tolist():
        _, before, after = drive.followed(k)
        z, z_after = before.astype(float), after.astype(float)
        if np.sum(np.all(z == z_after, axis=1)) > _FROZEN_SHARE * len(z):
            continue
        near = z[:, 0] - z[:, 2] > _MIN_DISPARITY
        z, z_after = z[near], z_after[near]
        steps.append(np.full(len(z), k))
        y.append(image_points_of(z))
        left.append(z_after[:, :2])
    return StepPairs(np.concatenate(steps), np.concatenate(y), np.concatenate(left))
