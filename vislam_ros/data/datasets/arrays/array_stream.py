# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The arrays of an ``.npz`` or ``.npy`` file as streams of numbers, each read once.

What a header says of an array's size, and an archive of a member's, is held against the bytes
that are there before anything of that size is made.
"""

import math
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vislam_ros.data.datasets.arrays.pickle_limits import MOST_OPCODES
from vislam_ros.data.datasets.arrays.restricted_pickle import load_plain
from vislam_ros.data.datasets.arrays.stored_array import StoredArray, StoredBytes
from vislam_ros.data.files.inputs import open_input
from vislam_ros.errors import VislamError

CHUNK_BYTES = 1 << 22

# Deflate makes at most so many times of what it reads (zlib's technical notes).
_LARGEST_RATIO = 1032
# A member that is held whole is small, or is not packed so tightly as zeros are [bytes, times].
_SMALL, _WHOLE_RATIO = 64 << 20, 16
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_MOST_DIMENSIONS = 32


@dataclass(frozen=True)
class ArrayStream:
    """An array in the order of its bytes.

    Attributes
    ----------
    shape : tuple of int
    fortran_order : bool
        Whether the first index runs fastest, not the last.
    dtype : dtype
    stored : int
        Bytes that it takes in the file.
    source : str
        What to call it in an error.
    chunks : iterator of ndarray, (n,)
        Its numbers, a few megabytes at a time; to be used once.
    """

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]
    stored: int
    source: str
    chunks: Iterator[NDArray[Any]]

    def array(self, dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """Read the whole array, as numbers of a type.

        Raises
        ------
        VislamError
            Where it is damaged, or unpacks to far more than it takes in the file.
        """
        size = math.prod(self.shape) * self.dtype.itemsize
        if size > max(_SMALL, _WHOLE_RATIO * self.stored):
            raise VislamError(
                f"{self.source}: unpacks {self.stored} bytes to {size}, which no such array does"
            )
        with np.errstate(over="ignore"):
            chunks = [chunk.astype(dtype) for chunk in self.chunks]
        flat = np.concatenate([np.empty(0, dtype), *chunks])
        return flat.reshape(self.shape, order="F" if self.fortran_order else "C")


Arrays = dict[str, Callable[[], ArrayStream]]


@contextmanager
def open_arrays(path: Path, what: str = "this dataset") -> Iterator[Arrays]:
    """Open a file of named arrays, an ``.npz`` or a dict in an ``.npy``, told apart by content.

    Parameters
    ----------
    path : Path
    what : str
        What to call it where it cannot be read.

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
    with open_input(path, what) as file:
        magic = file.read(6)
        file.seek(0)
        if magic[:2] == b"PK":
            with _clear_errors(str(path)):
                archive = zipfile.ZipFile(file)
            with archive:
                yield {
                    info.filename.removesuffix(".npy"): partial(_open_member, path, archive, info)
                    for info in archive.infolist()
                    if info.filename.endswith(".npy")
                }
        elif magic == b"\x93NUMPY":
            yield _arrays_of_dict(file, str(path), file.seek(0, 2))
        else:
            raise VislamError(
                f"{path}: is neither an .npz (a zip archive) nor an .npy file: see "
                "`vislam simulate` for one that is"
            )


@contextmanager
def _clear_errors(source: str) -> Iterator[None]:
    """Turn what zipfile, zlib and numpy raise on bad bytes into one line."""
    try:
        yield
    except (NotImplementedError, RecursionError, zipfile.LargeZipFile) as error:
        reason = " ".join(str(error).split())
        raise VislamError(f"{source}: cannot be unpacked: {reason}") from error
    except (VislamError, OSError):
        raise
    except RuntimeError as error:  # it is encrypted
        reason = " ".join(str(error).split())
        raise VislamError(f"{source}: cannot be unpacked: {reason}") from error
    except Exception as error:  # damaged bytes raise errors of every kind
        raise VislamError(f"{source}: is cut off or damaged: copy it anew") from error


def _open_member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> ArrayStream:
    """Read the header of a member and stream its numbers."""
    source = f"{path}: {info.filename.removesuffix('.npy')}"
    if info.compress_type not in _METHODS:
        raise VislamError(f"{source}: cannot be unpacked: save it with numpy's savez_compressed")
    if info.file_size > _LARGEST_RATIO * (info.compress_size + 1):
        raise VislamError(
            f"{source}: claims to unpack {info.compress_size} bytes to {info.file_size}, which "
            "cannot be"
        )
    with _clear_errors(source):
        file = archive.open(info)
    shape, fortran_order, dtype = _read_header(file, source)
    if dtype.hasobject:
        if info.file_size > max(_SMALL, _WHOLE_RATIO * info.compress_size):
            raise VislamError(f"{source}: unpacks to {info.file_size} bytes, which no object does")
        return stream_of(load_plain(file, source), source, info.compress_size)
    if dtype.kind not in "fiu":
        raise VislamError(f"{source}: holds {dtype}, not numbers")
    size, there = math.prod(shape) * dtype.itemsize, info.file_size - file.tell()
    if size != there:
        raise VislamError(
            f"{source}: its header claims {size} bytes of numbers and {there} are there: it is "
            "cut off or damaged: copy it anew"
        )
    chunks = _chunks(file, math.prod(shape), dtype, source)
    return ArrayStream(shape, fortran_order, dtype, info.compress_size, source, chunks)


_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def _read_header(file: IO[bytes], source: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    with _clear_errors(source):
        version = np.lib.format.read_magic(file)
        if version in _HEADERS:
            shape, fortran_order, dtype = _HEADERS[version](file)
            if len(shape) > _MOST_DIMENSIONS or not all(0 <= n < 1 << 48 for n in shape):
                raise ValueError("no shape of an array")
            return shape, fortran_order, dtype
    # Later versions differ only for fields with names that are not ASCII.
    raise VislamError(f"{source}: its .npy format {version} is not one for plain arrays")


def _chunks(
    file: IO[bytes], count: int, dtype: np.dtype[Any], source: str
) -> Iterator[NDArray[Any]]:
    with file, _clear_errors(source):
        for size in _chunk_sizes(count, dtype):
            data = file.read(size)
            if len(data) < size:
                raise EOFError
            yield np.frombuffer(data, dtype)


def _chunks_in_place(stored: StoredBytes, dtype: np.dtype[Any], source: str) -> Iterator[Any]:
    start = 0
    with _clear_errors(source):
        for size in _chunk_sizes(len(stored) // dtype.itemsize, dtype):
            yield np.frombuffer(stored.read(start, size), dtype)
            start += size


def _chunk_sizes(count: int, dtype: np.dtype[Any]) -> Iterator[int]:
    """Bytes of each chunk of so many numbers."""
    per_chunk = max(CHUNK_BYTES // dtype.itemsize, 1)
    for start in range(0, count, per_chunk):
        yield min(per_chunk, count - start) * dtype.itemsize


def _arrays_of_dict(file: IO[bytes], source: str, size: int) -> Arrays:
    """Open the dict that ``np.save`` put into an object array of shape (), in so many bytes."""
    file.seek(0)
    _, _, dtype = _read_header(file, source)
    content = None
    if dtype.hasobject:
        content = load_plain(file, source, leave_large=True)
    if not isinstance(content, dict):
        raise VislamError(f"{source}: holds no dict of arrays, as a dataset's .npy file does")
    return {
        name: partial(stream_of, value, f"{source}: {name}", size)
        for name, value in content.items()
        if isinstance(name, str)
    }


def stream_of(value: Any, source: str, stored: int) -> ArrayStream:
    """Stream an array that is in memory already, without copying it, or one left in its file.

    Parameters
    ----------
    value : object
        An array, in memory or left in its file, a number, or lists of them.
    source : str
        What to call it in an error.
    stored : int
        Bytes that it takes in the file.

    Raises
    ------
    VislamError
        Where it is no array of numbers.
    """
    if isinstance(value, StoredArray):
        _require_numbers(value.dtype, f"an array of {value.dtype}", source)
        chunks = _chunks_in_place(value.stored, value.dtype, source)
        return ArrayStream(
            value.shape, value.fortran_order, value.dtype, len(value.stored), source, chunks
        )
    _check_count(value, source)
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):  # lists of unequal lengths, huge numbers
        array = np.empty(0, dtype=object)
    _require_numbers(array.dtype, type(value).__name__, source)
    fortran_order = array.flags.f_contiguous and not array.flags.c_contiguous
    flat = array.reshape(-1, order="F" if fortran_order else "C")
    step = CHUNK_BYTES // array.itemsize
    chunks = (flat[start : start + step] for start in range(0, len(flat), step))
    return ArrayStream(array.shape, fortran_order, array.dtype, stored, source, chunks)


def _require_numbers(dtype: np.dtype[Any], what: str, source: str) -> None:
    if dtype.kind not in "fiu":
        raise VislamError(f"{source}: holds {what}, not an array of numbers")


def _check_count(value: Any, source: str) -> None:
    """Refuse lists in lists that hold more than their pickle could, one list in many places."""
    waiting, count = [value], 0
    while waiting:
        each = waiting.pop()
        if isinstance(each, (list, tuple)):
            count += len(each) + 1
            if count > MOST_OPCODES:
                raise VislamError(f"{source}: lists hold more numbers than there are: give arrays")
            waiting.extend(each)
