# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The exponential, the logarithm and their kin for a single motion, number by number.

Where there is one motion only, numpy's call overhead is ten times the arithmetic. The formulas
are those of se3, which comes here by itself; see there.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL_ANGLE = 1e-2
"""Under this angle the closed forms lose digits to cancellation, and their series, cut after the
fourth power, is exact to double precision: 1e-2**6 / 5040 < 1e-15."""

# The right Jacobian's coefficients cancel more: their series has one power more and serves up to
# this angle.
_SMALL_ANGLE_OF_JACOBIAN = 0.1


def exp(xi: Array) -> Array:
    """Motion (4, 4) of a tangent ``[rho; theta]`` (6,)."""
    a, b, c, x, y, z = xi.tolist()
    s, k, t = _exp_coefficients(x * x + y * y + z * z)
    # theta x rho, and theta x that.
    wx, wy, wz = y * c - z * b, z * a - x * c, x * b - y * a
    vx, vy, vz = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
    return np.array(
        [
            [1 - k * (y * y + z * z), k * x * y - s * z, k * x * z + s * y, a + k * wx + t * vx],
            [k * x * y + s * z, 1 - k * (x * x + z * z), k * y * z - s * x, b + k * wy + t * vy],
            [k * x * z - s * y, k * y * z + s * x, 1 - k * (x * x + y * y), c + k * wz + t * vz],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def log(T: Array) -> Array:
    """Tangent ``[rho; theta]`` (6,) of a motion (4, 4)."""
    (_, _, _, a), (_, _, _, b), (_, _, _, c), _ = T.tolist()
    x, y, z, w = quaternion_from_rotation(T[:3, :3]).tolist()
    n = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if n < 1e-9 else 2 * math.atan2(n, w) / n
    x, y, z = scale * x, scale * y, scale * z
    a2 = x * x + y * y + z * z
    if a2 < SMALL_ANGLE**2:
        f = 1 / 12 + a2 / 720 + a2 * a2 / 30240
    else:
        s, k, _ = _exp_coefficients(a2)
        f = (1 - s / (2 * k)) / a2
    wx, wy, wz = y * c - z * b, z * a - x * c, x * b - y * a
    vx, vy, vz = y * wz - z * wy, z * wx - x * wz, x * wy - y * wx
    return np.array([a - 0.5 * wx + f * vx, b - 0.5 * wy + f * vy, c - 0.5 * wz + f * vz, x, y, z])


def inverse(T: Array) -> Array:
    """Inverse of a motion (4, 4)."""
    (r00, r01, r02, a), (r10, r11, r12, b), (r20, r21, r22, c), _ = T.tolist()
    return np.array(
        [
            [r00, r10, r20, -(r00 * a + r10 * b + r20 * c)],
            [r01, r11, r21, -(r01 * a + r11 * b + r21 * c)],
            [r02, r12, r22, -(r02 * a + r12 * b + r22 * c)],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def adjoint(T: Array) -> Array:
    """Adjoint (6, 6) of a motion (4, 4)."""
    Ad = np.zeros((6, 6))
    R = T[:3, :3]
    Ad[:3, :3] = Ad[3:, 3:] = R
    a, b, c = T[:3, 3].tolist()
    Ad[:3, 3:] = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]]) @ R
    return Ad


def quaternion_from_rotation(R: Array) -> Array:
    """Unit quaternion (4,) x, y, z, w with w >= 0 of a rotation matrix (3, 3)."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = R.tolist()
    divisors = (
        1 + r00 - r11 - r22,
        1 - r00 + r11 - r22,
        1 - r00 - r11 + r22,
        1 + r00 + r11 + r22,
    )
    x, y, z, w = divisors
    largest = divisors.index(max(divisors))
    if largest == 3:
        x, y, z = r21 - r12, r02 - r20, r10 - r01
    elif largest == 0:
        y, z, w = r01 + r10, r02 + r20, r21 - r12
    elif largest == 1:
        x, z, w = r01 + r10, r12 + r21, r02 - r20
    else:
        x, y, w = r02 + r20, r12 + r21, r10 - r01
    n = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return np.array([x / n, y / n, z / n, w / n])


def rotation_from_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (4,) x, y, z, w; of one of length zero, NaN."""
    x, y, z, w = quaternion.tolist()
    square = x * x + y * y + z * z + w * w
    s = 2.0 / square if square else math.nan
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )


def right_jacobian(xi: Array) -> Array:
    """Right Jacobian (6, 6) of :func:`exp` at a tangent (6,).

    A polynomial of fourth degree in ``ad(-xi)``, by the theorem of Cayley and Hamilton (Barfoot
    2017, eq. 7.86).
    """
    a, b, c, x, y, z = (-xi).tolist()
    A = np.array(
        [
            [0, -z, y, 0, -c, b],
            [z, 0, -x, c, 0, -a],
            [-y, x, 0, -b, a, 0],
            [0, 0, 0, 0, -z, y],
            [0, 0, 0, z, 0, -x],
            [0, 0, 0, -y, x, 0],
        ]
    )
    a2 = x * x + y * y + z * z
    if a2 < _SMALL_ANGLE_OF_JACOBIAN**2:
        a4 = a2 * a2
        c1 = 1 / 2 - a4 / 720 + a4 * a2 / 20160
        c2 = 1 / 6 - a4 / 5040 + a4 * a2 / 181440
        c3 = 1 / 24 - a2 / 360 + a4 / 13440 - a4 * a2 / 907200
        c4 = 1 / 120 - a2 / 2520 + a4 / 120960 - a4 * a2 / 9979200
    else:
        angle = math.sqrt(a2)
        s, k = angle * math.sin(angle), math.cos(angle)
        c1 = (4 - s - 4 * k) / (2 * a2)
        c2 = (4 * a2 - 5 * s + a2 * k) / (2 * a2 * a2)
        c3 = (2 - s - 2 * k) / (2 * a2 * a2)
        c4 = (2 * a2 - 3 * s + a2 * k) / (2 * a2 * a2 * a2)
    A2 = A @ A
    J = c1 * A + c2 * A2 + A2 @ (c3 * A + c4 * A2)
    J.ravel()[::7] += 1.0
    return J


def _exp_coefficients(a2: float) -> tuple[float, float, float]:
    """Return sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3 for a^2."""
    if a2 < SMALL_ANGLE**2:
        return (
            1 - a2 / 6 + a2 * a2 / 120,
            0.5 - a2 / 24 + a2 * a2 / 720,
            1 / 6 - a2 / 120 + a2 * a2 / 5040,
        )
    a = math.sqrt(a2)
    return math.sin(a) / a, 2 * math.sin(a / 2) ** 2 / a2, (a - math.sin(a)) / (a * a2)
