# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of a pickle that stay in its file until they are needed.

A pickled array is a few opcodes and its numbers as they lie in memory. Opcodes that push many
bytes are replaced by ones that push a token, so the pickle that is loaded is small, and the
numbers are read from the file a few megabytes at a time.
"""

import io
import pickle
import struct
from dataclasses import dataclass
from functools import cached_property
from typing import IO, Any

import numpy as np

from vislam_ros.data.datasets.arrays.pickle_limits import Claims


@dataclass(frozen=True)
class StoredBytes:
    """So many bytes at a place of an open file."""

    file: IO[bytes]
    offset: int
    length: int

    def __len__(self) -> int:
        return self.length

    @cached_property
    def whole(self) -> bytes:
        """All of them, read once: what asks for them often holds them once."""
        return self.read(0, self.length)

    def read(self, start: int, size: int) -> bytes:
        """Read some of them; raises an EOFError where they are no more there."""
        self.file.seek(self.offset + start)
        data = self.file.read(size)
        if len(data) < size:
            raise EOFError
        return data


@dataclass(frozen=True)
class StoredArray:
    """An array of numbers that is still in its file.

    Attributes
    ----------
    shape : tuple of int
    dtype : dtype
    fortran_order : bool
        Whether the first index runs fastest, not the last.
    stored : StoredBytes
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool
    stored: StoredBytes


def without_large_bytes(file: IO[bytes], claims: Claims) -> tuple[IO[bytes], list[StoredBytes]]:
    """Pickle in memory whose large bytes are the numbers of those that are returned with it.

    Parameters
    ----------
    file : binary file
        Can be sought in.
    claims : Claims
        Of the pickle in it. Frames, which tell a reader how far to read ahead, are left out.

    Returns
    -------
    binary file, list of StoredBytes
        The pickle pushes ``k`` and asks for it by BINPERSID, an opcode that it has nowhere else.
    """
    parts: list[bytes] = []
    places: list[StoredBytes] = []
    kept = claims.begin
    for cut in claims.cuts:
        file.seek(kept)
        parts.append(file.read(cut.begin - kept))
        if cut.data is not None:
            parts.append(pickle.BININT + struct.pack("<i", len(places)) + pickle.BINPERSID)
            places.append(StoredBytes(file, cut.data, cut.end - cut.data))
        kept = cut.end
    file.seek(kept)
    parts.append(file.read(claims.end - kept))
    return io.BytesIO(b"".join(parts)), places
