# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera's motion between two frames, from their image points alone.

No twist, no extrinsics and no filter have a part in it, so it can be held against them. With the
ray ``x`` and the inverse depth ``lambda`` of a point in the old frame, the new one sees it along
``q = R x + lambda t``; Gauss-Newton on the errors of its three numbers in the new frame, with
Tukey's weights about the median, which half of the points cannot move. The noise of ``lambda``
would make t too short (by 8 % where a disparity of 7 pixels has 2 pixels of noise), so the new
frame's disparity, whose noise is another, is the instrument: ``Z^T J xi = Z^T e``, where Z is J
with that in the place of ``lambda``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera

Array = NDArray[np.float64]

#: Fewer points than this tell no motion against the wrong ones among them.
FEWEST_POINTS = 6

# Squared errors count up to this many times their median, 4.6 standard deviations.
_TUKEY = 9.0
# A median squared error below this would give weight to nothing but itself [square pixels].
_SMALLEST_SQUARE = 0.05
_ITERATIONS = 10
# What moves less has come to its end [m, rad].
_CONVERGED = 1e-3
# A point whose depth shrinks to less than this share of its old one has passed the camera.
_MIN_DEPTH_RATIO = 0.05
# Points that are fitted were seen to move as one if they are off by no more than this [px], or by
# less than a half of what they moved.
_CLOSE, _SHARE = 5.0, 0.5


class ImageMotion(NamedTuple):
    """What two frames tell of the camera's motion between them.

    Attributes
    ----------
    xi : ndarray, (6,)
        Its pose in the new frame seen from the old one is ``Exp(xi)``, ``[rho; theta]``.
    metric : ndarray, (6, 6)
        ``e^T metric e``: mean square of how far an error e of ``xi`` moves the points, pixels.
    T_new_old : ndarray, (4, 4)
        The same motion, to start the next search from.
    is_one : bool
        Whether the points move as those of one rigid scene at all.
    """

    xi: Array
    metric: Array
    T_new_old: Array
    is_one: bool


def image_motion(camera: StereoCamera, before: Array, after: Array, start: Array) -> ImageMotion:
    """Find the motion between two frames of the same points.

    Parameters
    ----------
    camera : StereoCamera
        Of which only the intrinsics and the baseline are used.
    before, after : ndarray, (n, 3)
        ``(u_left, u_right, v)``, pixels, of at least FEWEST_POINTS points.
    start : ndarray, (4, 4)
        A motion of the old frame in the new one to try besides standing still.
    """
    T, metric, moved, error = _fitted(
        before,
        after,
        start,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        camera.fx_baseline,
    )
    found = bool(np.isfinite(T).all() and error <= max(_CLOSE, _SHARE * moved))
    if not found:
        return ImageMotion(np.zeros(6), metric, np.eye(4), is_one=False)
    return ImageMotion(-se3.log(T), metric, T, is_one=True)


@compiled(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64, float64, float64, float64,"
    " float64, float64[:, ::1], float64[:, ::1], float64[::1])"
)
def _errors(
    before: Array,
    after: Array,
    T: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    fxb: float,
    moved: Array,
    error: Array,
    square: Array,
) -> None:
    """Fill in the moved rays (n, 3), their errors (n, 3) in the new frame and the squares (n,)."""
    for i in range(len(before)):
        x, row = (before[i, 0] - cx) / fx, (before[i, 2] - cy) / fy
        inverse_depth = (before[i, 0] - before[i, 1]) / fxb
        for k in range(3):
            moved[i, k] = T[k, 0] * x + T[k, 1] * row + T[k, 2] + T[k, 3] * inverse_depth
        if not moved[i, 2] > _MIN_DEPTH_RATIO:
            square[i] = np.inf
            continue
        w = 1.0 / moved[i, 2]
        left = fx * moved[i, 0] * w + cx
        error[i, 0] = after[i, 0] - left
        error[i, 1] = after[i, 1] - left + fxb * inverse_depth * w
        error[i, 2] = after[i, 2] - fy * moved[i, 1] * w - cy
        square[i] = error[i, 0] ** 2 + error[i, 1] ** 2 + error[i, 2] ** 2


@compiled(
    "float64(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1],"
    " float64, float64, float64, float64, float64[:, ::1], float64[::1], float64[:, ::1])"
)
def _normal_equations(
    before: Array,
    after: Array,
    moved: Array,
    error: Array,
    square: Array,
    middle: float,
    fx: float,
    fy: float,
    fxb: float,
    A: Array,
    b: Array,
    metric: Array,
) -> float:
    """Fill in ``A xi = b`` of a motion ``q <- q + lambda rho + theta x q``, and ``J^T J``.

    Return the sum of the weights.
    """
    A[:] = 0.0
    b[:] = 0.0
    metric[:] = 0.0
    J, Z, by_ray, weights = np.empty(6), np.empty(6), np.zeros((3, 3)), 0.0
    for i in range(len(before)):
        ratio = square[i] / (_TUKEY * middle)
        if not ratio < 1.0:
            continue
        weight = (1.0 - ratio) ** 2
        weights += weight
        inverse_depth = (before[i, 0] - before[i, 1]) / fxb
        x, y, z = moved[i]
        instrument = z * (after[i, 0] - after[i, 1]) / fxb
        w = 1.0 / z
        by_ray[0, 0] = by_ray[1, 0] = fx * w
        by_ray[0, 2] = -fx * x * w * w
        by_ray[1, 2] = by_ray[0, 2] + fxb * inverse_depth * w * w
        by_ray[2, 1], by_ray[2, 2] = fy * w, -fy * y * w * w
        for r in range(3):
            g0, g1, g2 = by_ray[r]
            J[0], J[1], J[2] = g0 * inverse_depth, g1 * inverse_depth, g2 * inverse_depth
            J[3], J[4], J[5] = g2 * y - g1 * z, g0 * z - g2 * x, g1 * x - g0 * y
            Z[0], Z[1], Z[2] = g0 * instrument, g1 * instrument, g2 * instrument
            Z[3], Z[4], Z[5] = J[3], J[4], J[5]
            for k in range(6):
                b[k] += weight * Z[k] * error[i, r]
                for j in range(6):
                    A[k, j] += weight * Z[k] * J[j]
                    metric[k, j] += weight * J[k] * J[j]
    return weights


@compiled("float64[:, ::1](float64[::1])")
def _small_motion(xi: Array) -> Array:
    """Motion (4, 4) whose rotation is exactly one and whose translation is ``rho``."""
    a, b, c = 0.5 * xi[3], 0.5 * xi[4], 0.5 * xi[5]
    n = 1.0 / (1.0 + a * a + b * b + c * c)
    T = np.eye(4)
    T[0, 0], T[0, 1], T[0, 2] = (
        1 - 2 * n * (b * b + c * c),
        2 * n * (a * b - c),
        2 * n * (a * c + b),
    )
    T[1, 0], T[1, 1], T[1, 2] = (
        2 * n * (a * b + c),
        1 - 2 * n * (a * a + c * c),
        2 * n * (b * c - a),
    )
    T[2, 0], T[2, 1], T[2, 2] = (
        2 * n * (a * c - b),
        2 * n * (b * c + a),
        1 - 2 * n * (a * a + b * b),
    )
    T[0, 3], T[1, 3], T[2, 3] = xi[0], xi[1], xi[2]
    return T


@compiled(
    "Tuple((float64[:, ::1], float64[:, ::1], float64, float64))(float64[:, ::1],"
    " float64[:, ::1], float64[:, ::1], float64, float64, float64, float64, float64)"
)
def _fitted(
    before: Array,
    after: Array,
    start: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    fxb: float,
) -> tuple[Array, Array, float, float]:
    """Motion, metric, and the medians of how far points moved and of the errors left, pixels."""
    n = len(before)
    moved, error, square = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    A, b, metric = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6))
    T = np.eye(4)
    _errors(before, after, T, fx, fy, cx, cy, fxb, moved, error, square)
    displacement = np.median(square)
    _errors(before, after, start, fx, fy, cx, cy, fxb, moved, error, square)
    if np.median(square) < displacement:
        T = start.copy()
    weights = 0.0
    for _ in range(_ITERATIONS):
        _errors(before, after, T, fx, fy, cx, cy, fxb, moved, error, square)
        middle = max(np.median(square), _SMALLEST_SQUARE)
        weights = _normal_equations(
            before, after, moved, error, square, middle, fx, fy, fxb, A, b, metric
        )
        for k in range(6):
            # What the points do not tell stays as it is.
            A[k, k] += 1e-9 * abs(A[k, k]) + 1e-9
        xi = np.linalg.solve(A, b)
        T = _small_motion(np.asarray(xi)) @ T
        if np.max(np.abs(xi)) < _CONVERGED:
            break
    _errors(before, after, T, fx, fy, cx, cy, fxb, moved, error, square)
    return T, metric / max(weights, 1.0), np.sqrt(displacement), np.sqrt(np.median(square))
