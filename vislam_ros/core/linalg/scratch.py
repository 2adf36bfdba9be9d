# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory that is used again in every step."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Scratch:
    """Matrices that are used again in every step.

    Fresh memory of some hundred kB comes from the kernel page by page, which takes longer than
    the arithmetic on it.
    """

    def __init__(self) -> None:
        self._memory: dict[str, Array] = {}

    def matrix(self, name: str, rows: int, columns: int) -> Array:
        """Return the matrix of a name in this size, C-ordered, with anything in it."""
        memory = self._memory.get(name)
        if memory is None or len(memory) < rows * columns:
            # Twice what is asked for: sizes come and go.
            memory = self._memory[name] = np.empty(2 * rows * columns)
        return memory[: rows * columns].reshape(rows, columns)

    def successor(self, P: Array, size: int) -> Array:
        """Return a matrix (size, size) for what comes after P, of two that take turns."""
        name = "second" if P.base is self._memory.get("first") else "first"
        return self.matrix(name, size, size)


class FreshMemory(Scratch):
    """Scratch that gives new matrices: for whoever keeps what was worked out in them."""

    def matrix(self, name: str, rows: int, columns: int) -> Array:
        """Return a new matrix, C-ordered, with anything in it."""
        return np.empty((rows, columns))
