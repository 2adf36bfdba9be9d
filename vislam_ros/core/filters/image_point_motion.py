# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion of the robocentric error state: its F over a step.

With ``T <- T Exp(tau u)`` and ``y <- w(y, Exp(tau u))`` the errors go over by ::

    pose      Ad(Exp(-tau u)) xi + tau J_r delta_u
    landmark  F_y delta_y + tau G J_r delta_u + (F_y D(y) - D(y+)) delta_kappa

where J_r is the right Jacobian at ``tau u``, F_y and G are those of the warp, and D is the shift
of the lens, which an error is told apart from (see lens).
"""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.filters.vehicle_state import POSE, SIZE, TWIST
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.warp import Warp
from vislam_ros.core.operations.transition import Transition

Array = NDArray[np.float64]


def transition_of(
    camera: StereoCamera, y: Array, warped: Warp, motion: Array, twist: Array, tau: float
) -> Transition:
    """F of a motion (4, 4), tau seconds at a twist (6,), that has warped image points (n, 3)."""
    by_twist = tau * se3.right_jacobian(tau * twist)
    vehicle = np.eye(SIZE)
    vehicle[POSE, POSE] = se3.adjoint(se3.inverse(motion))
    vehicle[POSE, TWIST] = by_twist
    shift, shift_new = radial_shift(camera, y), radial_shift(camera, warped.y)
    coupling = _coupling(warped.G, by_twist, warped.F_y, shift, shift_new)
    return Transition(vehicle, warped.F_y, coupling)


@compiled(
    "float64[:, :, ::1](float64[:, :, ::1], float64[:, :], float64[:, :, ::1], float64[:, ::1],"
    " float64[:, ::1])"
)
def _coupling(G: Array, by_twist: Array, F_y: Array, shift: Array, shift_new: Array) -> Array:
    """How warped points (n, 3) depend on the vehicle state but the pose: on twist and lens."""
    n = len(G)
    coupling = np.zeros((n, 3, SIZE - 6))
    for i in range(n):
        for r in range(3):
            for c in range(6):
                for k in range(6):
                    coupling[i, r, c] += G[i, r, k] * by_twist[k, c]
            for k in range(3):
                coupling[i, r, -1] += F_y[i, r, k] * shift[i, k]
            coupling[i, r, -1] -= shift_new[i, r]
    return coupling
