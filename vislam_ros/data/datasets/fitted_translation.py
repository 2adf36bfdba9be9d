# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The translation over a step that fits the images best, where nothing measures a velocity.

With the rotation R of a gyroscope a point ``p`` of before is at ``R p + t``, and its pixel (u, v)
of after is linear in t: ``fx (q_x + t_x) - (u - cx) (q_z + t_z) = 0`` with ``q = R p``, and so for
the row. Divided by ``q_z`` both are pixels; what is far off counts for less.
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

# Fewer points than this fit any rotation.
_FEWEST_POINTS = 4
_ROUNDS = 5
_SMALLEST = 1e-3  # pixels


def fitted_translations(
    camera: StereoCamera, steps: NDArray[np.int64], turned: Array, left: Array
) -> Array:
    """Translation (n, 3) of the left camera's points over their step, metres.

    Parameters
    ----------
    camera : StereoCamera
    steps : ndarray of int64, (n,)
        Step of each point.
    turned : ndarray, (n, 3)
        Points of before in the left camera, turned to its axes of after, metres.
    left : ndarray, (n, 2)
        Where the left image has them after, pixels.

    Returns
    -------
    ndarray, (n, 3)
        The same for all points of a step; NaN where they are too few.
    """
    result = np.full_like(turned, np.nan)
    for step in np.unique(steps):
        rows = np.flatnonzero(steps == step)
        if len(rows) >= _FEWEST_POINTS:
            result[rows] = _fitted(camera, turned[rows], left[rows])
    return result


def _fitted(camera: StereoCamera, q: Array, left: Array) -> Array:
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    off_centre = left - centre
    A = np.zeros((len(q), 2, 3))
    A[:, 0, 0], A[:, 1, 1] = focal
    A[:, :, 2] = -off_centre
    A /= q[:, 2, None, None]
    b = off_centre - focal * q[:, :2] / q[:, 2:]
    weights, t = np.ones(len(q)), np.zeros(3)
    for _ in range(_ROUNDS):
        weighted = (A * weights[:, None, None]).reshape(-1, 3)
        t = np.linalg.lstsq(weighted, (b * weights[:, None]).ravel(), rcond=None)[0]
        error = np.linalg.norm(b - A @ t, axis=1)
        weights = 1.0 / np.sqrt(1.0 + np.square(error / max(np.median(error), _SMALLEST)))
    return np.asarray(t)
