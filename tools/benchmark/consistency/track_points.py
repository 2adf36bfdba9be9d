# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the point of a track lies, the motion being known."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.warp import Warp, warp

Array = NDArray[np.float64]

#: Derivative of a disparity by ``(u_left, u_right, v)``.
BY_POINT = np.array([1.0, -1.0, 0.0])

_ITERATIONS = 6
# Holds the disparity of a point without parallax, 1 / pixels.
_WEAK = 0.01


class TrackPoint(NamedTuple):
    """The point that fits a track.

    Attributes
    ----------
    point : ndarray, (3,)
        ``(u_left, u_right, v)`` in the first frame, pixels.
    expected : ndarray, (n, 3)
        The same in each frame.
    information : ndarray, (3, 3)
        Of the point, where each number has a noise of a pixel over the root of its weight.
    """

    point: Array
    expected: Array
    information: Array


def moved_points(camera: StereoCamera, point: Array, motions: Array) -> Warp:
    """Image points of one point (3,) after each of the body's motions (n, 4, 4)."""
    return warp(camera, np.tile(point, (len(motions), 1)), motions)


def fitted_point(
    camera: StereoCamera, motions: Array, y: Array, weights: Array
) -> TrackPoint | None:
    """Fit a point to its image points by weighted least squares.

    Parameters
    ----------
    camera : StereoCamera
    motions : ndarray, (n, 4, 4)
        Of the body from the first frame of the track to each.
    y : ndarray, (n, 3)
        Observed ``(u_left, u_right, v)``, pixels.
    weights : ndarray, (3,)
        Of the three numbers.

    Returns
    -------
    TrackPoint or None
        None where the search takes the point out of view.
    """
    point = y[0]
    root = np.sqrt(weights)
    weak = _WEAK * BY_POINT
    for _ in range(_ITERATIONS):
        warped = moved_points(camera, point, motions)
        if not warped.ahead.all():
            return None
        J = np.concatenate([(root[:, None] * warped.F_y).reshape(-1, 3), weak[None]])
        r = np.append((root * (y - warped.y)).ravel(), weak @ (y[0] - point))
        point = point + np.linalg.lstsq(J, r, rcond=None)[0]
    warped = moved_points(camera, point, motions)
    return TrackPoint(point, warped.y, J.T @ J) if warped.ahead.all() else None
