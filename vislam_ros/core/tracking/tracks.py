# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Track continuity: which observations belong to one physical point.

A track's id is not enough to know a point. When a tracker repeats a whole frame's pixels while
the body moves (a frozen frame), it goes on from the stale pixels afterwards, so every repeated
track stands for another point from then on. Such a track, one that was unseen for a while, and
one whose observation was rejected, begins anew under the same id. The last one rests before: what
slides over the scene goes on to do so, and each time that it began anew it would be believed for
a frame or two. A frame that is missing has seen nothing: what comes after a hole is not read
against the points from before it, of which those last longest that go along with the body. Each
physical point gets a key of its own, counted from 0 in the order of first appearance; the
filters know only keys.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.tracking.spread import best_spread
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame

# A live track whose point has ended; its pixels still tell whether the next frame is frozen.
NO_KEY = -1


@compiled("int64[::1](int64[:], int64[:])")
def indices_of(keys: Keys, table: Keys) -> NDArray[np.int64]:
    """Places (n,) in a table (m,) of different keys, in any order, of keys (n,); -1 for none."""
    order = np.argsort(table)
    result = np.empty(len(keys), dtype=np.int64)
    for i in range(len(keys)):
        low, high = 0, len(order)
        while low < high:
            middle = (low + high) // 2
            if table[order[middle]] < keys[i]:
                low = middle + 1
            else:
                high = middle
        there = low < len(order) and table[order[low]] == keys[i]
        result[i] = order[low] if there else -1
    return result


def is_member(keys: Keys, table: Keys) -> NDArray[np.bool_]:
    """Tell which keys (n,) are in a table (m,) of different keys, in any order."""
    return indices_of(keys, table) >= 0


class Tracks:
    """Keeps the table of live tracks.

    Parameters
    ----------
    retire_after : int
        Frames without an observation after which a track ends.
    frozen_share : float or None
        Share of repeated tracks above which a frame is frozen; None never finds any.
    most : int or None
        Tracks that are followed at a time; where a frame has more new ones than there is room
        for, those are taken that cover the image best, and the others are as if unseen. None sets
        no bound.
    rest_after_rejection : int
        Frames for which a track whose observation was rejected is left out, unless it comes to
        stand for another point before.
    """

    def __init__(
        self,
        retire_after: int,
        frozen_share: float | None,
        rest_after_rejection: int = 0,
        *,
        most: int | None = None,
    ):
        self._most = most
        self._retire_after = retire_after
        self._frozen_share = frozen_share
        self._rest_after_rejection = rest_after_rejection
        # The live tracks, by increasing id.
        self._ids = np.empty(0, dtype=np.uint32)
        self._keys = np.empty(0, dtype=np.int64)
        self._pixels = np.empty((0, 4), dtype=np.float32)
        self._unseen = np.empty(0, dtype=np.int64)
        self._rest = np.empty(0, dtype=np.int64)
        # Of every key ever given.
        self._id_of_key: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
        self._generation_of_key: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
        self._next_generation: dict[int, int] = {}
        self._next_key = 0

    @classmethod
    def of(cls, settings: SlamSettings) -> "Tracks":
        """Make a table that follows the rules of a session."""
        tracks = cls(settings.retire_after, None)
        tracks.follow(settings)
        return tracks

    def follow(self, settings: SlamSettings) -> None:
        """Follow the rules of a session from the next frame on."""
        self._most = settings.max_active
        self._retire_after = settings.retire_after
        self._frozen_share = settings.frozen_share if settings.track_continuity else None
        self._rest_after_rejection = settings.rest_after_rejection

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

    def ids_of(self, keys: Keys) -> NDArray[np.uint32]:
        """Ids of keys (n,)."""
        return self.identity(keys)[0]

    def observe(
        self,
        ids: NDArray[np.uint32],
        pixels: NDArray[np.float32],
        motion_expected: Callable[[], bool],
        missed: int = 0,
        noise: NDArray[np.float32] | None = None,
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
        missed : int
            Frames that are missing before this one: in them nothing was seen.
        noise : ndarray of float32, (n,), optional
            As their source states it, pixels.

        Returns
        -------
        TrackedFrame
        """
        # What comes from a message may be read-only, which compiled loops do not take.
        ids, pixels = np.array(ids, np.uint32), np.array(pixels, np.float32)
        if np.any(ids[1:] < ids[:-1]):
            order = np.argsort(ids)
            ids, pixels = ids[order], pixels[order]
            noise = None if noise is None else noise[order]
        ended_before = self._miss(missed)
        chosen = self._chosen(ids, pixels)
        left_out = len(ids)
        if chosen is not None:
            ids, pixels = ids[chosen], pixels[chosen]
            noise = None if noise is None else noise[chosen]
        left_out -= len(ids)
        keys, copied, in_last_frame, found, rest = _continued(
            ids, pixels, self._ids, self._keys, self._pixels, self._unseen, self._rest
        )
        frozen = (
            self._frozen_share is not None
            and int(copied.sum()) > self._frozen_share * int(in_last_frame.sum())
            and motion_expected()
        )
        if not frozen:
            copied[:] = False
        ended = [keys[copied], ended_before]
        # A copied track stands for another point now, so it rests no longer.
        fresh = ((keys == NO_KEY) & (rest == 0)) | copied
        keys[fresh] = self._new_keys(ids[fresh])

        self._unseen += 1
        missing = np.flatnonzero(~found)
        lost = self._unseen[missing] >= self._retire_after
        ended.append(self._keys[missing[lost]])
        self._store(ids, keys, pixels, np.maximum(rest - 1, 0), missing[~lost])
        all_ended = np.concatenate(ended)
        by_key = np.argsort(keys)[np.count_nonzero(keys == NO_KEY) :]
        return TrackedFrame(
            keys=keys[by_key],
            pixels=pixels[by_key].astype(float),
            ended=np.sort(all_ended[all_ended != NO_KEY]),
            copied=copied[by_key],
            frozen=frozen,
            left_out=left_out,
            noise=None if noise is None else noise[by_key].astype(float),
        )

    def _miss(self, missed: int) -> Keys:
        """Let frames pass in which nothing is seen; return the points that end with them."""
        self._unseen += missed
        self._rest = np.maximum(self._rest - missed, 0)
        lost = self._unseen >= self._retire_after
        ended: Keys = self._keys[lost]
        self._keys[lost] = NO_KEY
        return ended

    def _chosen(
        self, ids: NDArray[np.uint32], pixels: NDArray[np.float32]
    ) -> NDArray[np.int64] | None:
        """Places of the observations that there is room for; None where there is for all."""
        if self._most is None or len(ids) + len(self._ids) <= self._most:
            return None
        known = np.isin(ids, self._ids, assume_unique=True)
        goes_on = self._unseen + 1 < self._retire_after
        waiting = np.count_nonzero(goes_on & ~np.isin(self._ids, ids, assume_unique=True))
        (new,) = np.nonzero(~known)
        room = self._most - int(np.count_nonzero(known)) - int(waiting)
        if len(new) <= room:
            return None
        taken = new[best_spread(pixels[new], max(room, 0), pixels[known])]
        return np.sort(np.concatenate([np.flatnonzero(known), taken]))

    def restart(self, keys: Keys, *, rest: bool) -> None:
        """End points whose observation was rejected; their ids may rest before they go on."""
        if len(keys):
            rejected = is_member(self._keys, keys)
            self._keys[rejected] = NO_KEY
            self._rest[rejected] = self._rest_after_rejection if rest else 0

    def _store(
        self,
        ids: NDArray[np.uint32],
        keys: Keys,
        pixels: NDArray[np.float32],
        rest: NDArray[np.int64],
        waiting: NDArray[np.int64],
    ) -> None:
        """Keep what is seen, and of what is not the tracks that may come back."""
        unseen = np.zeros(len(ids), dtype=np.int64)
        if len(waiting):
            ids = np.concatenate([ids, self._ids[waiting]])
            keys = np.concatenate([keys, self._keys[waiting]])
            pixels = np.concatenate([pixels, self._pixels[waiting]])
            rest = np.concatenate([rest, self._rest[waiting]])
            unseen = np.concatenate([unseen, self._unseen[waiting]])
            order = np.argsort(ids)
            ids, keys, pixels, rest = ids[order], keys[order], pixels[order], rest[order]
            unseen = unseen[order]
        self._ids, self._keys, self._pixels = ids, keys, pixels
        self._rest, self._unseen = rest, unseen

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


@compiled(
    "Tuple((int64[::1], boolean[::1], boolean[::1], boolean[::1], int64[::1]))(uint32[:],"
    " float32[:, :], uint32[:], int64[:], float32[:, :], int64[:], int64[:])"
)
def _continued(
    ids: NDArray[np.uint32],
    pixels: NDArray[np.float32],
    table_ids: NDArray[np.uint32],
    table_keys: Keys,
    table_pixels: NDArray[np.float32],
    table_unseen: NDArray[np.int64],
    table_rest: NDArray[np.int64],
) -> tuple[Keys, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int64]]:
    """Find a frame's ids in the table; both are in increasing order.

    Returns
    -------
    keys : ndarray of int64, (n,)
        Each id's point, NO_KEY where it has none.
    copied, in_last_frame : ndarray of bool, (n,)
        Whether an id was in the last frame, and there at these very pixels.
    found : ndarray of bool, (m,)
        Which rows of the table have their ids in the frame.
    rest : ndarray of int64, (n,)
        Frames for which each id's observations are still left out.
    """
    keys = np.empty(len(ids), dtype=np.int64)
    copied = np.zeros(len(ids), dtype=np.bool_)
    in_last_frame = np.zeros(len(ids), dtype=np.bool_)
    found = np.zeros(len(table_ids), dtype=np.bool_)
    rest = np.zeros(len(ids), dtype=np.int64)
    row = 0
    for i in range(len(ids)):
        keys[i] = NO_KEY
        while row < len(table_ids) and table_ids[row] < ids[i]:
            row += 1
        if row < len(table_ids) and table_ids[row] == ids[i]:
            found[row] = True
            keys[i] = table_keys[row]
            rest[i] = table_rest[row]
            in_last_frame[i] = table_unseen[row] == 0
            copied[i] = in_last_frame[i]
            for k in range(4):
                copied[i] = copied[i] and pixels[i, k] == table_pixels[row, k]
    return keys, copied, in_last_frame, found, rest
