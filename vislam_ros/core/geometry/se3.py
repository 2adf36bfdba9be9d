# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rigid motions in three dimensions: SE(3), its exponential, and unit quaternions.

Every function takes leading batch dimensions. The tangent is ``xi = [rho; theta]``; formulas
follow Barfoot, *State Estimation for Robotics* (2017), chapter 7, with errors on the right. The
report's hats of a twist (eq. 14-15 and 53-54) are needed in exponentials alone: ``exp(tau u^)`` of
eq. 10, 12, 49 and 51 is :func:`exp`, ``exp(-tau u^curly)`` of eq. 13, 52 and 66 is :func:`adjoint`
of its inverse.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry import se3_single
from vislam_ros.core.geometry.se3_single import SMALL_ANGLE

Array = NDArray[np.float64]


def hat(omega: ArrayLike) -> Array:
    """Cross-product matrix of a vector.

    Parameters
    ----------
    omega : array_like, (..., 3)

    Returns
    -------
    ndarray, (..., 3, 3)
        Skew-symmetric ``W`` with ``W @ b = cross(omega, b)``.
    """
    omega = np.asarray(omega, dtype=float)
    x, y, z = omega[..., 0], omega[..., 1], omega[..., 2]
    matrix = np.zeros((*omega.shape[:-1], 3, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def _exp_coefficients(angle_squared: Array) -> tuple[Array, Array, Array]:
    """Return sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3 for an array of a^2."""
    a2 = angle_squared
    small = a2 < SMALL_ANGLE**2
    safe = np.where(small, 1.0, a2)
    a = np.sqrt(safe)
    sine = np.where(small, 1 - a2 / 6 + a2**2 / 120, np.sin(a) / a)
    # 1 - cos a = 2 sin^2(a/2) keeps its digits where 1 - cos a would not.
    cosine = np.where(small, 0.5 - a2 / 24 + a2**2 / 720, 2 * np.sin(a / 2) ** 2 / safe)
    third = np.where(small, 1 / 6 - a2 / 120 + a2**2 / 5040, (a - np.sin(a)) / (a * safe))
    return sine, cosine, third


def exp_rotation(theta: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues' formula).

    Parameters
    ----------
    theta : array_like, (..., 3)
        Rotation vector, radians.

    Returns
    -------
    ndarray, (..., 3, 3)
    """
    theta = np.asarray(theta, dtype=float)
    sine, cosine, _ = _exp_coefficients(np.sum(theta**2, axis=-1))
    W = hat(theta)
    return np.eye(3) + sine[..., None, None] * W + cosine[..., None, None] * (W @ W)


def exp(xi: ArrayLike) -> Array:
    """Exponential of se(3): the motion after unit time at twist ``xi``.

    Parameters
    ----------
    xi : array_like, (..., 6)
        ``[rho; theta]``, metres and radians.

    Returns
    -------
    ndarray, (..., 4, 4)
    """
    xi = np.asarray(xi, dtype=float)
    if xi.ndim == 1:
        return se3_single.exp(xi)
    rho, theta = xi[..., :3], xi[..., 3:]
    sine, cosine, third = _exp_coefficients(np.sum(theta**2, axis=-1))
    W = hat(theta)
    W2 = W @ W
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = np.eye(3) + sine[..., None, None] * W + cosine[..., None, None] * W2
    V = np.eye(3) + cosine[..., None, None] * W + third[..., None, None] * W2
    T[..., :3, 3] = (V @ rho[..., None])[..., 0]
    T[..., 3, 3] = 1.0
    return T


def log_rotation(R: ArrayLike) -> Array:
    """Rotation vector of a rotation matrix, of length at most pi.

    Goes by way of the unit quaternion, which stays well conditioned up to a half turn.

    Parameters
    ----------
    R : array_like, (..., 3, 3)

    Returns
    -------
    ndarray, (..., 3)
        Radians.
    """
    q = quaternion_from_rotation(R)
    vector, w = q[..., :3], q[..., 3]
    n = np.linalg.norm(vector, axis=-1)
    small = n < 1e-9
    scale = np.where(small, 2.0, 2 * np.arctan2(n, w) / np.where(small, 1.0, n))
    return scale[..., None] * vector


def log(T: ArrayLike) -> Array:
    """Logarithm of SE(3): the inverse of :func:`exp`.

    Parameters
    ----------
    T : array_like, (..., 4, 4)

    Returns
    -------
    ndarray, (..., 6)
        ``[rho; theta]`` with the rotation's length at most pi.
    """
    T = np.asarray(T, dtype=float)
    if T.ndim == 2:
        return se3_single.log(T)
    theta = log_rotation(T[..., :3, :3])
    a2 = np.sum(theta**2, axis=-1)
    sine, cosine, _ = _exp_coefficients(a2)
    # V^-1 = I - W/2 + (1/a^2)(1 - sin(a) / (2 a (1 - cos a)/a^2)) W^2
    small = a2 < SMALL_ANGLE**2
    safe = np.where(small, 1.0, a2)
    series = 1 / 12 + a2 / 720 + a2**2 / 30240
    coefficient = np.where(small, series, (1 - sine / (2 * cosine)) / safe)
    W = hat(theta)
    V_inverse = np.eye(3) - 0.5 * W + coefficient[..., None, None] * (W @ W)
    rho = (V_inverse @ T[..., :3, 3, None])[..., 0]
    return np.concatenate([rho, theta], axis=-1)


def inverse(T: ArrayLike) -> Array:
    """Inverse of rigid motions, shape (..., 4, 4), by transposing the rotation."""
    T = np.asarray(T, dtype=float)
    if T.ndim == 2:
        return se3_single.inverse(T)
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    result = np.zeros_like(T)
    result[..., :3, :3] = R_transposed
    result[..., :3, 3] = -(R_transposed @ T[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def adjoint(T: ArrayLike) -> Array:
    """Adjoint of rigid motions: ``T Exp(xi) T^-1 = Exp(Ad(T) xi)``.

    Parameters
    ----------
    T : array_like, (..., 4, 4)

    Returns
    -------
    ndarray, (..., 6, 6)
        ``[[R, hat(p) R], [0, R]]``.
    """
    T = np.asarray(T, dtype=float)
    if T.ndim == 2:
        return se3_single.adjoint(T)
    R, p = T[..., :3, :3], T[..., :3, 3]
    Ad = np.zeros((*T.shape[:-2], 6, 6))
    Ad[..., :3, :3] = R
    Ad[..., 3:, 3:] = R
    Ad[..., :3, 3:] = hat(p) @ R
    return Ad


def right_jacobian(xi: ArrayLike) -> Array:
    """Right Jacobian of the exponential: ``Exp(xi + d) = Exp(xi) Exp(J_r(xi) d)`` to first order.

    Parameters
    ----------
    xi : array_like, (6,)

    Returns
    -------
    ndarray, (6, 6)
    """
    return se3_single.right_jacobian(np.asarray(xi, dtype=float))


def odot(s: ArrayLike) -> Array:
    """Matrix of ``xi -> hat(xi) s`` for a homogeneous point: the report's ``s^odot`` (57).

    Parameters
    ----------
    s : array_like, (..., 4)

    Returns
    -------
    ndarray, (..., 4, 6)
        ``[[s4 I, -hat(s)], [0, 0]]``.
    """
    s = np.asarray(s, dtype=float)
    result = np.zeros((*s.shape[:-1], 4, 6))
    result[..., :3, :3] = s[..., 3, None, None] * np.eye(3)
    result[..., :3, 3:] = -hat(s[..., :3])
    return result


def interpolate(T_a: ArrayLike, T_b: ArrayLike, fraction: float) -> Array:
    """Pose on the constant-twist path from ``T_a`` (fraction 0) to ``T_b`` (fraction 1)."""
    T_a = np.asarray(T_a, dtype=float)
    return T_a @ exp(fraction * log(inverse(T_a) @ np.asarray(T_b, dtype=float)))


def nearest_rotation(R: ArrayLike) -> Array:
    """Rotation matrix nearest to ``R`` in the Frobenius norm, shape (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(np.asarray(R, dtype=float))
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt


def pose_matrix(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """Homogeneous matrix (..., 4, 4) of positions (..., 3) and quaternions (..., 4) x, y, z, w."""
    position = np.asarray(position, dtype=float)
    T = np.zeros((*position.shape[:-1], 4, 4))
    T[..., :3, :3] = rotation_from_quaternion(quaternion)
    T[..., :3, 3] = position
    T[..., 3, 3] = 1.0
    return T


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrix (..., 3, 3) of quaternions (..., 4) x, y, z, w of any length but zero."""
    q = np.asarray(quaternion, dtype=float)
    if q.ndim == 1:
        return se3_single.rotation_from_quaternion(q)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0] = 1 - 2 * (y * y + z * z)
    R[..., 0, 1] = 2 * (x * y - w * z)
    R[..., 0, 2] = 2 * (x * z + w * y)
    R[..., 1, 0] = 2 * (x * y + w * z)
    R[..., 1, 1] = 1 - 2 * (x * x + z * z)
    R[..., 1, 2] = 2 * (y * z - w * x)
    R[..., 2, 0] = 2 * (x * z - w * y)
    R[..., 2, 1] = 2 * (y * z + w * x)
    R[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return R


def quaternion_from_rotation(R: ArrayLike) -> Array:
    """Unit quaternions (..., 4) x, y, z, w with w >= 0 of rotation matrices (..., 3, 3).

    Shepperd's method: of four equal formulas it takes the one with the largest divisor.
    """
    R = np.asarray(R, dtype=float)
    if R.ndim == 2:
        return se3_single.quaternion_from_rotation(R)
    r00, r01, r02 = R[..., 0, 0], R[..., 0, 1], R[..., 0, 2]
    r10, r11, r12 = R[..., 1, 0], R[..., 1, 1], R[..., 1, 2]
    r20, r21, r22 = R[..., 2, 0], R[..., 2, 1], R[..., 2, 2]
    # Row k of K is 4 q_k q, for k = x, y, z, w.
    K = np.empty((*R.shape[:-2], 4, 4))
    K[..., 0, 0] = 1 + r00 - r11 - r22
    K[..., 1, 1] = 1 - r00 + r11 - r22
    K[..., 2, 2] = 1 - r00 - r11 + r22
    K[..., 3, 3] = 1 + r00 + r11 + r22
    K[..., 0, 1] = K[..., 1, 0] = r01 + r10
    K[..., 0, 2] = K[..., 2, 0] = r02 + r20
    K[..., 1, 2] = K[..., 2, 1] = r12 + r21
    K[..., 0, 3] = K[..., 3, 0] = r21 - r12
    K[..., 1, 3] = K[..., 3, 1] = r02 - r20
    K[..., 2, 3] = K[..., 3, 2] = r10 - r01
    largest = np.argmax(np.diagonal(K, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(K, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., 3:] < 0, -q, q)
