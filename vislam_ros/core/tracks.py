# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Track continuity: which observations belong to one physical point.

A track's id is not enough to know a point. When a tracker repeats a whole frame's pixels while
the body moves (a frozen frame), it goes on from the stale pixels afterwards, so every repeated
track stands for another point from then on. Such a track, one that was unseen for a while, and
one whose observation was rejected, begins anew under the same id. Each physical point gets a key
of its own, counted from 0 in the order of first appearance; the filters know only keys.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Keys = NDArray[np.int64]

# A live track whose point has ended; its pixels still tell whether the next frame is frozen.
NO_KEY = -1


def slots_of(keys: Keys, table: Keys) -> NDArray[np.int64]:
    """Places (n,) in a table (m,) of different keys, in any order, of keys (n,) that are in it."""
    order = np.argsort(table)
    return order[np.searchsorted(table, keys, sorter=order)]


def among(keys: Keys, table: Keys) -> NDArray[np.bool_]:
    """Tell which keys (n,) are in a table (m,) of different keys, in any order."""
    if not len(table):
        return np.zeros(len(keys), dtype=bool)
    ordered = np.sort(table)
    place = np.searchsorted(ordered, keys)
    place[place == len(ordered)] = 0
    return ordered[place] == keys


@dataclass(frozen=True)
class TrackedFrame:
    """One features message, its observations told apart by physical point.

    Attributes
    ----------
    keys : ndarray of int64, (n,)
        Physical point of each observation, increasing.
    pixels : ndarray, (n, 4)
        ``u_left, v_left, u_right, v_right`` in the order of ``keys``.
    ended : ndarray of int64, (m,)
        Points that will not be seen again.
    copied : ndarray of bool, (n,)
        Which observations of a frozen frame repeat the last one's pixels; each begins a point.
    frozen : bool
        Whether the frame repeats the last one's pixels while the body moves.
    """

    keys: Keys
    pixels: NDArray[np.float64]
    ended: Keys
    copied: NDArray[np.bool_]
    frozen: bool


class Tracks:
    """Keeps the table of live tracks.

    Parameters
    ----------
    retire_after : int
        Frames without an observation after which a track ends.
    frozen_share : float or None
        Share of repeated tracks above which a frame is frozen; None never finds any.
    """

    def __init__(self, retire_after: int, frozen_share: float | None):
        self._retire_after = retire_after
        self._frozen_share = frozen_share
        # The live tracks, by increasing id.
        self._ids = np.empty(0, dtype=np.uint32)
        self._keys = np.empty(0, dtype=np.int64)
        self._pixels = np.empty((0, 4), dtype=np.float32)
        self._unseen = np.empty(0, dtype=np.int64)
        # Of every key ever given.
        self._id_of_key: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
        self._generation_of_key: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
        self._next_generation: dict[int, int] = {}
        self._next_key = 0

    @property
    def ids_seen(self) -> int:
        """Number of different ids so far."""
        return len(self._next_generation)

    def last_pixels(self) -> NDArray[np.float32]:
        """Pixels (n, 4) of the last frame."""
        return self._pixels[self._unseen == 0]

    def identity(self, keys: Keys) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Ids and generations of keys (n,)."""
        self._id_of_key = [np.concatenate(self._id_of_key)]
        self._generation_of_key = [np.concatenate(self._generation_of_key)]
        return self._id_of_key[0][keys], self._generation_of_key[0][keys]

    def observe(
        self,
        ids: NDArray[np.uint32],
        pixels: NDArray[np.float32],
        motion_expected: Callable[[], bool],
    ) -> TrackedFrame:
        """Take a frame.

        Parameters
        ----------
        ids : ndarray of uint32, (n,)
            All different.
        pixels : ndarray of float32, (n, 4)
        motion_expected : callable
            Tells whether the body moves so far that honest pixels would have changed; is asked
            only where many have not.

        Returns
        -------
        TrackedFrame
        """
        if np.any(ids[1:] < ids[:-1]):
            order = np.argsort(ids)
            ids, pixels = ids[order], pixels[order]
        row = np.searchsorted(self._ids, ids)
        row_inside = np.minimum(row, max(len(self._ids) - 1, 0))
        known = np.zeros(len(ids), dtype=bool)
        if len(self._ids):
            known = self._ids[row_inside] == ids
        keys = np.full(len(ids), NO_KEY, dtype=np.int64)
        keys[known] = self._keys[row_inside[known]]

        copied = np.zeros(len(ids), dtype=bool)
        copied[known] = np.all(pixels[known] == self._pixels[row_inside[known]], axis=1)
        in_last_frame = np.zeros(len(ids), dtype=bool)
        in_last_frame[known] = self._unseen[row_inside[known]] == 0
        copied &= in_last_frame
        frozen = (
            self._frozen_share is not None
            and int(copied.sum()) > self._frozen_share * int(in_last_frame.sum())
            and motion_expected()
        )
        ended = [keys[copied]] if frozen else []
        fresh = (keys == NO_KEY) | (copied & frozen)
        keys[fresh] = self._new_keys(ids[fresh])

        missing = np.ones(len(self._ids), dtype=bool)
        missing[row_inside[known]] = False
        unseen = self._unseen[missing] + 1
        lost = unseen >= self._retire_after
        ended.append(self._keys[missing][lost])
        self._store(
            np.concatenate([ids, self._ids[missing][~lost]]),
            np.concatenate([keys, self._keys[missing][~lost]]),
            np.concatenate([pixels, self._pixels[missing][~lost]]),
            np.concatenate([np.zeros(len(ids), dtype=np.int64), unseen[~lost]]),
        )
        all_ended = np.concatenate(ended)
        by_key = np.argsort(keys)
        return TrackedFrame(
            keys=keys[by_key],
            pixels=pixels[by_key].astype(float),
            ended=np.sort(all_ended[all_ended != NO_KEY]),
            copied=(copied & frozen)[by_key],
            frozen=frozen,
        )

    def restart(self, keys: Keys) -> None:
        """End points whose observation was rejected; their ids begin anew when next seen."""
        if len(keys):
            self._keys[among(self._keys, keys)] = NO_KEY

    def _store(
        self,
        ids: NDArray[np.uint32],
        keys: Keys,
        pixels: NDArray[np.float32],
        unseen: NDArray[np.int64],
    ) -> None:
        order = np.argsort(ids)
        self._ids, self._keys = ids[order], keys[order]
        self._pixels, self._unseen = pixels[order], unseen[order]

    def _new_keys(self, ids: NDArray[np.uint32]) -> Keys:
        """Give each of these ids its next physical point."""
        generations = np.empty(len(ids), dtype=np.uint32)
        for i, track in enumerate(ids.tolist()):
            generations[i] = self._next_generation.get(track, 0)
            self._next_generation[track] = int(generations[i]) + 1
        self._id_of_key.append(ids)
        self._generation_of_key.append(generations)
        keys = np.arange(self._next_key, self._next_key + len(ids))
        self._next_key += len(ids)
        return keys
