# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What all later observations say of an error state.

The adjoints of the modified Bryson-Frazier smoother (Bierman, *Fixed interval smoothing with
discrete measurements*, 1973): if C is the cross-covariance of anything with the error state at
some time, then all that was observed later moves its estimate by ``C lambda`` and lowers its
covariance by ``C Lambda C^T``.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.motion import symmetrized

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Adjoint:
    """What is said of an error state.

    Attributes
    ----------
    vector : ndarray, (D,)
        lambda.
    matrix : ndarray, (D, D)
        Lambda, symmetric.
    """

    vector: Array
    matrix: Array

    @classmethod
    def zero(cls, size: int) -> "Adjoint":
        """At the end of a drive nothing more is observed."""
        return cls(np.zeros(size), np.zeros((size, size)))


class Backward(Protocol):
    """The way back through an operation, made where the operation is applied once more."""

    def backward(self, later: Adjoint) -> Adjoint:
        """Take what is said after the operation to before it, in place where the size stays."""


def moved_by(later: Adjoint, cross: Array, covariances: Array) -> tuple[Array, Array]:
    """Moves and covariances of variables after all that came later.

    Parameters
    ----------
    later : Adjoint
    cross : ndarray, (m k, D)
        Cross-covariance C of m variables of k numbers with the error state.
    covariances : ndarray, (m, k, k)
        Of the variables as they stood.

    Returns
    -------
    moves : ndarray, (m, k)
        ``C lambda``.
    covariances : ndarray, (m, k, k)
        ``P - C Lambda C^T``.
    """
    m, k, _ = covariances.shape
    C_Lambda = (cross @ later.matrix).reshape(m, k, -1)
    gain = C_Lambda @ np.swapaxes(cross.reshape(m, k, -1), -1, -2)
    return (cross @ later.vector).reshape(m, k), symmetrized(covariances - gain)
