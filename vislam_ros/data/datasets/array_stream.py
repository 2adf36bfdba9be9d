# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The arrays of an ``.npz`` or ``.npy`` file as streams of numbers, each read once."""

import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.datasets.restricted_pickle import load_plain
from vislam_ros.errors import VislamError

CHUNK_BYTES = 1 << 22


@dataclass(frozen=True)
class ArrayStream:
    """An array in the order of its bytes.

    Attributes
    ----------
    shape : tuple of int
    fortran_order : bool
        Whether the first index runs fastest, not the last.
    chunks : iterator of ndarray, (n,)
        Its numbers, a few megabytes at a time; to be used once.
    """

    shape: tuple[int, ...]
    fortran_order: bool
    chunks: Iterator[NDArray[Any]]

    def array(self) -> NDArray[np.float64]:
        """Read the whole array."""
        flat = np.concatenate([np.empty(0), *self.chunks])
        return flat.reshape(self.shape, order="F" if self.fortran_order else "C")


Arrays = dict[str, Callable[[], ArrayStream]]


@contextmanager
def open_arrays(path: Path) -> Iterator[Arrays]:
    """Open a file of named arrays, an ``.npz`` or a dict in an ``.npy``, told apart by content.

    Yields
    ------
    dict
        For each name a function that opens its stream.

    Raises
    ------
    VislamError
        Where the file is missing, is neither kind, is cut off or damaged, or holds a pickle with
        anything but numbers and plain containers.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(6)
            file.seek(0)
            if magic[:2] == b"PK":
                with _clear_errors(str(path)):
                    archive = zipfile.ZipFile(file)
                with archive:
                    yield {
                        info.filename.removesuffix(".npy"): partial(
                            _open_member, path, archive, info
                        )
                        for info in archive.infolist()
                        if info.filename.endswith(".npy")
                    }
            elif magic == b"\x93NUMPY":
                yield _arrays_of_dict(file, str(path))
            else:
                raise VislamError(
                    f"{path}: is neither an .npz (a zip archive) nor an .npy file: see "
                    "`vislam simulate` for one that is"
                )
    except OSError as error:
        reason = error.strerror or str(error)
        raise VislamError(f"{path}: cannot read this dataset: {reason}") from error


@contextmanager
def _clear_errors(source: str) -> Iterator[None]:
    """Turn what zipfile, zlib and numpy raise on bad bytes into one line."""
    try:
        yield
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError) as error:
        raise VislamError(f"{source}: is cut off or damaged: copy it anew") from error
    except (NotImplementedError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise VislamError(f"{source}: cannot be unpacked: {reason}") from error


def _open_member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> ArrayStream:
    """Read the header of a member and stream its numbers."""
    source = f"{path}: {info.filename.removesuffix('.npy')}"
    with _clear_errors(source):
        file = archive.open(info)
    shape, fortran_order, dtype = _read_header(file, source)
    if dtype.hasobject:
        return stream_of(load_plain(file, source), source)
    if dtype.kind not in "fiu":
        raise VislamError(f"{source}: holds {dtype}, not numbers")
    return ArrayStream(shape, fortran_order, _chunks(file, math.prod(shape), dtype, source))


def _read_header(file: IO[bytes], source: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    with _clear_errors(source):
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            return np.lib.format.read_array_header_1_0(file)
        if version == (2, 0):
            return np.lib.format.read_array_header_2_0(file)
    # Later versions differ only for fields with names that are not ASCII.
    raise VislamError(f"{source}: its .npy format {version} is not one for plain arrays")


def _chunks(
    file: IO[bytes], count: int, dtype: np.dtype[Any], source: str
) -> Iterator[NDArray[Any]]:
    per_chunk = max(CHUNK_BYTES // dtype.itemsize, 1)
    with file, _clear_errors(source):
        for start in range(0, count, per_chunk):
            size = min(per_chunk, count - start) * dtype.itemsize
            data = file.read(size)
            if len(data) < size:
                raise EOFError
            yield np.frombuffer(data, dtype)


def _arrays_of_dict(file: IO[bytes], source: str) -> Arrays:
    """Open the dict that ``np.save`` put into an object array of shape ()."""
    _, _, dtype = _read_header(file, source)
    content = load_plain(file, source) if dtype.hasobject else None
    if not isinstance(content, dict):
        raise VislamError(f"{source}: holds no dict of arrays, as a dataset's .npy file does")
    return {
        str(name): partial(stream_of, value, f"{source}: {name}")
        for name, value in content.items()
    }


def stream_of(value: Any, source: str) -> ArrayStream:
    """Stream an array that is in memory already, without copying it where its order allows.

    Raises
    ------
    VislamError
        Where it is no array of numbers.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "fiu":
        raise VislamError(f"{source}: holds {type(value).__name__}, not an array of numbers")
    fortran_order = array.flags.f_contiguous and not array.flags.c_contiguous
    flat = array.reshape(-1, order="F" if fortran_order else "C")
    step = CHUNK_BYTES // array.itemsize
    chunks = (flat[start : start + step] for start in range(0, len(flat), step))
    return ArrayStream(array.shape, fortran_order, chunks)
