# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The landmark map that a filter gives, and the store of landmarks it has marginalized."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LandmarkMap:
    """Landmarks in the world.

    Attributes
    ----------
    ids : ndarray of uint32, (M,)
        Track ids as the features messages give them.
    generations : ndarray of uint32, (M,)
        Counts the physical points that one id has stood for, from 0.
    positions : ndarray, (M, 3)
        Metres.
    covariances : ndarray, (M, 3, 3)
        Square metres.
    """

    ids: NDArray[np.uint32]
    generations: NDArray[np.uint32]
    positions: Array
    covariances: Array

    @classmethod
    def empty(cls) -> "LandmarkMap":
        """Make a map of no landmarks."""
        ids = np.empty(0, dtype=np.uint32)
        return cls(ids, ids, np.empty((0, 3)), np.empty((0, 3, 3)))

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        return f"<LandmarkMap: {len(self)} landmarks of {len(np.unique(self.ids))} tracks>"


class LandmarkStore:
    """Landmarks marginalized, known by their keys (see tracks).

    Attributes
    ----------
    count : int
        How many they are.
    """

    def __init__(self) -> None:
        self.count = 0
        self._keys: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
        self._means: list[Array] = [np.empty((0, 3))]
        self._covariances: list[Array] = [np.empty((0, 3, 3))]

    def add(self, keys: NDArray[np.int64], means: Array, covariances: Array) -> None:
        """Add landmarks: keys (n,), means (n, 3), covariances (n, 3, 3)."""
        if len(keys):
            self.count += len(keys)
            self._keys.append(keys)
            self._means.append(means)
            self._covariances.append(covariances)

    def all(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Keys (M,), means (M, 3) and covariances (M, 3, 3) of all, in the order they came."""
        self._keys = [np.concatenate(self._keys)]
        self._means = [np.concatenate(self._means)]
        self._covariances = [np.concatenate(self._covariances)]
        return self._keys[0], self._means[0], self._covariances[0]
